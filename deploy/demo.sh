#!/usr/bin/env bash
# The main job from nothing: installs what is missing, builds, lets three vehicles map one place
# together, and prints what came out.
#
#   deploy/demo.sh                       three rendered vehicles
#   deploy/demo.sh SEQUENCE[:START-END]...  real sequences, one vehicle each
#
# Everything is left in out/demo.
set -euo pipefail

root="$(cd "$(dirname "$0")/.." && pwd)"
cd "$root"
started=$SECONDS
output=out/demo
mkdir -p out
build=build/release

echo "== Build"
deploy/build.sh release portolan-agent portolan-server portolan portolan-synthetic

specs=()
truths=()
if [ "$#" -eq 0 ]; then
  echo "== Render three vehicles"
  "$build/tests/synthetic/portolan-synthetic" --out out/synthetic --mission three_agents \
    --format jpg > out/synthetic.log 2>&1 || { cat out/synthetic.log >&2; exit 1; }
  for i in 0 1 2; do
    specs+=("vehicle$i=out/synthetic/agent$i")
    truths+=("out/synthetic/agent$i/groundtruth.txt")
  done
else
  i=0
  for sequence in "$@"; do
    specs+=("vehicle$i=$sequence")
    folder="${sequence%:*-*}"
    for name in groundtruth.txt reference_sfm.txt; do
      if [ -f "$folder/$name" ]; then truths+=("$folder/$name"); break; fi
    done
    i=$((i + 1))
  done
fi

echo "== Map with ${#specs[@]} vehicles, in real time"
deploy/mission.sh "$output" "${specs[@]}" -- --rate 1

echo
echo "== Vehicles"
sed -n 's/^agent /  /p' "$output"/logs/agent_*.log
echo
echo "== Map"
sed 's/^/  /' "$output/info.txt"
if [ "${#truths[@]}" -eq "${#specs[@]}" ]; then
  estimates=()
  live=()
  for spec in "${specs[@]}"; do
    estimates+=(--estimate "$output/final/${spec%%=*}.tum")
    live+=(--estimate "$output/agents/${spec%%=*}/live.tum")
  done
  references=()
  for truth in "${truths[@]}"; do references+=(--groundtruth "$truth"); done
  echo
  echo "A single camera sees no metre: a map without metric scale is fitted to the truth in size, too, and"
  echo "\"scale error\" says how its own unit differs from a metre."
  echo
  echo "== Accuracy, live: what each vehicle knew at that instant; not counted are the instants at"
  echo "   which it had no place in the common map yet"
  "$build/server/cli/portolan" evaluate "${live[@]}" "${references[@]}"
  echo
  echo "== Accuracy, corrected: every frame in the final map"
  "$build/server/cli/portolan" evaluate "${estimates[@]}" "${references[@]}" \
    --plot "$output/accuracy.png"
fi
echo
echo "Left in $output: map.db (the map), final/*.tum (trajectories), map.ply, map.png, accuracy.png"
echo "Ask the map again: $build/server/portolan-server --map $output/map.db, and then"
echo "                   $build/server/cli/portolan landmarks --near 0,0,2 -k 10"
echo "Took $((SECONDS - started)) s, building included."
