"""Expert data, training, reference methods, evaluation and benchmarks: what no robot needs."""
