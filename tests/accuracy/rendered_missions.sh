#!/usr/bin/env bash
# Maps of rendered fleets, IMU off: joint Sim(3) ATE of all frames of all agents, in mm and in
# percent of the average path.
#
#   tests/accuracy/rendered_missions.sh [SEED] [FRAMES] [WxH]      1 300 752x480
set -euo pipefail

root="$(cd "$(dirname "$0")/../.." && pwd)"
cd "$root"
build="build/${PORTOLAN_PRESET:-release}"
seed="${1:-1}"
frames="${2:-300}"
size="${3:-752x480}"
output="out/rendered"
rm -rf "$output"
mkdir -p "$output"

for mission in three_agents five_agents; do
  "$build/tests/synthetic/portolan-synthetic" --out "$output/images" --mission "$mission" \
    --seed "$seed" --frames "$frames" --size "$size" > "$output/render.log"
  for folder in "$output"/images/agent*; do
    name="$(basename "$folder")"
    "$build/agent/portolan-agent" "$folder" --agent "$name" --server none --session 1 \
      --outbox "$output/$mission/$name" --no-progress --log_level error >> "$output/agents.log"
  done
  "$build/tests/accuracy/robustness/portolan-replay" --runs 1 --groundtruth "$output/images" \
    "$output/$mission" 2> /dev/null | sed -n '1,2p'
  rm -rf "$output/images"
done
