#!/usr/bin/env bash
# Do the maps of several agents merge in every run? Records the split real sequences with ten seeds
# of the agents' RANSAC, and redkitchen with later starts, then maps each recording with another
# order of the submaps, another seed of the verifier and other times of the background work.
#
#   tests/accuracy/merge_robustness.sh [RECORDINGS]      10
set -euo pipefail

root="$(cd "$(dirname "$0")/../.." && pwd)"
cd "$root"
data="${PORTOLAN_DATA:-../shared/data}"
build="build/${PORTOLAN_PRESET:-release}"
recordings="${1:-10}"
output="out/merge"
if [ ! -d "$data" ]; then
  echo "NO DATA: set PORTOLAN_DATA to the folder of the real sequences" >&2
  exit 1
fi
rm -rf "$output"
mkdir -p "$output"

record() {  # FOLDER SEQUENCE SEED RANGE...
  local folder="$1" sequence="$2" seed="$3" i=0
  shift 3
  for range in "$@"; do
    "$build/agent/portolan-agent" "$data/$sequence" --agent "agent$i" --server none \
      --session $((i + 1)) --outbox "$folder/agent$i" --start "${range%-*}" --end "${range#*-}" \
      --filter.ransac_seed "$seed" --no-progress --log_level error >> "$output/agents.log"
    i=$((i + 1))
  done
}

replay() {  # TRUTH FOLDER...: run 1 of the first folder, run 2 of the second, ...
  local truth="$1" run=0
  shift
  for folder in "$@"; do
    run=$((run + 1))
    "$build/tests/accuracy/robustness/portolan-replay" --runs 1 --first-run "$run" \
      --groundtruth "$data/$truth" "$folder" 2> /dev/null | sed -n 2p
  done
}

echo "recording                     run  parts    ATE mm    % path   part mm  coverage  closures"
while read -r name sequence truth ranges; do
  folders=()
  for seed in $(seq "$recordings"); do
    folders+=("$output/${name}_seed$seed")
    # shellcheck disable=SC2086
    record "$output/${name}_seed$seed" "$sequence" "$seed" $ranges
  done
  replay "$sequence/$truth" "${folders[@]}"
done << 'END'
redkitchen 7scenes/redkitchen_seq-01 groundtruth.txt 0-302 303-605 606-909
MH_01 euroc/MH_01_easy_first18s groundtruth.txt 0-179 180-359
scenelib monoslam_davison/scenelib_test_sequence reference_sfm.txt 0-333 334-667 668-999
END
folders=()
for later in 3 7 11; do
  folders+=("$output/redkitchen_later$later")
  record "$output/redkitchen_later$later" 7scenes/redkitchen_seq-01 1 \
    "$later-302" "$((303 + later))-605" "$((606 + later))-909"
done
replay 7scenes/redkitchen_seq-01/groundtruth.txt "${folders[@]}"
