"""The diffusion process against the schedulers of `diffusers`."""

from __future__ import annotations

from itertools import pairwise

import pytest
import torch

from vgdp_planner.diffusion import DiffusionProcess, Prediction, cosine_alpha_bars

diffusers = pytest.importorskip('diffusers')

SHAPE = (3, 4, 8)


def draws(count: int) -> list[torch.Tensor]:
    """Return repeatable Gaussian tensors."""
    generator = torch.Generator().manual_seed(1)
    return [torch.randn(SHAPE, generator=generator) for _ in range(count)]


def test_schedule() -> None:
    """The cosine schedule is that of the reference."""
    reference = diffusers.DDPMScheduler(32, beta_schedule='squaredcos_cap_v2').alphas_cumprod
    torch.testing.assert_close(cosine_alpha_bars(32).float(), reference, rtol=1e-5, atol=1e-7)


def test_forward_noise() -> None:
    """Noise is added as in the reference."""
    clean, noise = draws(2)
    step = torch.tensor([0, 13, 31])
    reference = diffusers.DDPMScheduler(32, beta_schedule='squaredcos_cap_v2')
    ours = DiffusionProcess(32, 'epsilon').add_noise(clean, noise, step)
    torch.testing.assert_close(ours, reference.add_noise(clean, noise, step), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize('prediction', ['epsilon', 'sample'])
@pytest.mark.parametrize('step', [1, 7, 31])
def test_ddpm_step(prediction: Prediction, step: int) -> None:
    """A DDPM step equals the reference's, given the same noise."""
    output, noisy, noise = draws(3)
    process = DiffusionProcess(32, prediction)
    reference = diffusers.DDPMScheduler(
        32, beta_schedule='squaredcos_cap_v2', prediction_type=prediction
    )
    expected = reference.step(
        output, step, noisy, generator=torch.Generator().manual_seed(5)
    ).prev_sample
    drawn = torch.randn(SHAPE, generator=torch.Generator().manual_seed(5))
    del noise
    clean = process.predict_clean(output, noisy, step)
    ours = process.step_back(clean, noisy, step, step - 1, drawn)
    torch.testing.assert_close(ours, expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize('prediction', ['epsilon', 'sample'])
def test_ddim_step(prediction: Prediction) -> None:
    """A DDIM step over several diffusion steps equals the reference's."""
    output, noisy = draws(2)
    process = DiffusionProcess(32, prediction)
    reference = diffusers.DDIMScheduler(
        32,
        beta_schedule='squaredcos_cap_v2',
        prediction_type=prediction,
        clip_sample=True,
        set_alpha_to_one=True,
    )
    reference.set_timesteps(4)
    expected = reference.step(output, 24, noisy, use_clipped_model_output=True).prev_sample
    clean = process.predict_clean(output, noisy, 24)
    ours = process.step_back(clean, noisy, 24, 16, None)
    torch.testing.assert_close(ours, expected, rtol=1e-4, atol=1e-4)


def test_last_step_returns_the_clean_sample() -> None:
    """After the last step nothing of the noise is left."""
    clean, noisy = draws(2)
    assert torch.equal(DiffusionProcess(32, 'sample').step_back(clean, noisy, 0, -1, None), clean)


@pytest.mark.parametrize('count', [0, 33])
def test_impossible_step_counts_are_refused(count: int) -> None:
    """More sampling steps than training steps, or none, are an error."""
    with pytest.raises(ValueError, match=str(count)):
        DiffusionProcess(32, 'sample').sampling_steps(count)


@pytest.mark.parametrize('count', [1, 2, 3, 4, 8, 32])
def test_sampling_steps(count: int) -> None:
    """The steps begin at the last one and are spread as those of the reference."""
    reference = diffusers.DDIMScheduler(32, timestep_spacing='trailing')
    reference.set_timesteps(count)
    assert DiffusionProcess(32, 'sample').sampling_steps(count) == reference.timesteps.tolist()


def test_sampling_steps_fall_strictly() -> None:
    """No step comes twice, and all of them are taken where as many are asked for."""
    process = DiffusionProcess(32, 'sample')
    for count in range(1, 33):
        steps = process.sampling_steps(count)
        assert len(steps) == count
        assert steps[0] == 31
        assert all(later < earlier for earlier, later in pairwise(steps))
    assert process.sampling_steps(32) == list(range(31, -1, -1))
