#!/usr/bin/env bash
# Run a demo for 20 seeds and print a table; other arguments go to `vgdp demo`, or to DEMO instead.
# FIRST and COUNT choose the seeds. The exit code is 0 only if every demo succeeded.
set -uo pipefail
cd "$(dirname "$0")/.."
first=${FIRST:-0}
count=${COUNT:-20}
demo=${DEMO:-demo}
successes=0
for ((seed = first; seed < first + count; seed++)); do
  out=out/$demo-seeds/$seed
  mkdir -p "$out"
  if .venv/bin/vgdp "$demo" --rate 0 "$@" --seed "$seed" --out "$out" >"$out/output.txt" 2>&1; then
    successes=$((successes + 1))
  fi
  printf 'seed %3d  %s\n' "$seed" "$(tail -n 1 "$out/output.txt")"
done
echo "$successes of $count demos succeeded"
[ "$successes" -eq "$count" ]
