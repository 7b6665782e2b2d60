#!/usr/bin/env bash
# Identical-looking places: three vehicles in a rendered hall where all walls show one repeated tile
# and all crates one texture. Maps every seed in a few orders and prints, for each, the parts of the
# map and their errors; the last lines count the maps that were put together wrongly.
#
#   tests/accuracy/repeated_texture.sh [SEEDS] [MISSION] [FRAMES]      20 repeated_texture 120
set -euo pipefail

root="$(cd "$(dirname "$0")/../.." && pwd)"
cd "$root"
build="build/${PORTOLAN_PRESET:-release}"
seeds="${1:-20}"
mission="${2:-repeated_texture}"
frames="${3:-120}"
output="out/$mission"
rm -rf "$output"
mkdir -p "$output"

for seed in $(seq "$seeds"); do
  "$build/tests/synthetic/portolan-synthetic" --out "$output/images" --mission "$mission" \
    --seed "$seed" --frames "$frames" --size 376x240 --format pgm > "$output/render.log"
  for folder in "$output"/images/agent*; do
    name="$(basename "$folder")"
    "$build/agent/portolan-agent" "$folder" --agent "$name" --server none --session 1 \
      --outbox "$output/seed$seed/$name" --no-progress --log_level error > "$output/agent.log"
  done
  "$build/tests/accuracy/robustness/portolan-replay" --runs 1 --groundtruth "$output/images" \
    "$output/seed$seed" 2> /dev/null | sed -n '1,3p' | { [ "$seed" -eq 1 ] && cat || sed 1d; }
  rm -rf "$output/images"
done | tee "$output/table.txt"
awk '/ with a wrong part/ {n++; split($0, a, ", "); split(a[2], b, " "); w += b[1]}
     END {printf "%d of %d maps with a wrong part\n", w, n}' "$output/table.txt"
