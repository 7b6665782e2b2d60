#!/usr/bin/env bash
# What the removal of redundancy costs and saves on the real sequences: records each with agents that
# have no server, then replays the recording with everything kept, without redundant keyframes,
# without redundant landmarks, and without both.
#
#   tests/accuracy/redundancy.sh [WORD]    sequences whose name contains it
set -euo pipefail

root="$(cd "$(dirname "$0")/../.." && pwd)"
cd "$root"
data="${PORTOLAN_DATA:-../shared/data}"
build="build/${PORTOLAN_PRESET:-release}"
word="${1:-}"
output="out/redundancy"
if [ ! -d "$data" ]; then
  echo "NO DATA: set PORTOLAN_DATA to the folder of the real sequences" >&2
  exit 1
fi
mkdir -p "$output"

replay() {  # NAME LABEL TRUTH KEYFRAMES LANDMARKS
  "$build/tests/accuracy/robustness/portolan-replay" --runs 1 --groundtruth "$data/$3" \
    --keyframe-information "$4" --landmark-information "$5" "$output/$1" 2> /dev/null |
    sed -n "2s/^[^ ]* */$(printf '%-16s' "$2") /p"
}

echo "                  run  parts    ATE mm    % path   part mm  coverage  closures keyframes" \
  "landmarks published observations  CPU s"
while read -r name sequence truth ranges; do
  if [[ "$name" != *"$word"* ]]; then continue; fi
  rm -rf "${output:?}/$name"
  i=0
  for range in $ranges; do
    "$build/agent/portolan-agent" "$data/$sequence" --agent "agent$i" --server none \
      --session $((i + 1)) --outbox "$output/$name/agent$i" --start "${range%-*}" \
      --end "${range#*-}" --no-progress --log_level error > "$output/agents.log" < /dev/null
    i=$((i + 1))
  done
  echo "$name"
  replay "$name" "all" "$sequence/$truth" 1 1
  replay "$name" "keyframes" "$sequence/$truth" 0.5 1
  replay "$name" "landmarks" "$sequence/$truth" 1 0.9
  replay "$name" "both (default)" "$sequence/$truth" 0.5 0.9
done << 'END'
redkitchen 7scenes/redkitchen_seq-01 groundtruth.txt 0-909
redkitchen_thirds 7scenes/redkitchen_seq-01 groundtruth.txt 0-302 303-605 606-909
MH_01 euroc/MH_01_easy_first18s groundtruth.txt 0-359
checkerboard_desk uzh_vamr/checkerboard_desk groundtruth.txt 0-735
scenelib monoslam_davison/scenelib_test_sequence reference_sfm.txt 0-999
desk_translation openekf/desk_translation reference_sfm.txt 0-358
kitti kitti/odometry_00_first200 groundtruth.txt 0-199
END
