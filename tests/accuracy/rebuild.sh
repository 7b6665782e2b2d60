#!/usr/bin/env bash
# Is the map that is rebuilt from the raw submaps the one that the live run made?
#
#   tests/accuracy/rebuild.sh GROUNDTRUTH FOLDER...      folders of deploy/mission.sh
#
# One line a folder: joint ATE in mm (RMSE after one Sim(3) alignment, all frames) of its map, settled,
# and of the one that `portolan-server --rebuild` makes of a copy. Needs the release build.
set -euo pipefail
cd "$(dirname "$0")/../.."
if [ "$#" -lt 2 ]; then
  sed -n '2,8s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
groundtruth="$1"
shift
build=build/release/server
output=out/rebuild

. deploy/local_server.sh

ate_m() {  # FOLDER SERVER-FLAGS...
  local folder="$1"
  shift
  rm -rf "$output"
  mkdir -p "$output/trajectories"
  cp "$folder"/map.db* "$output/"
  start_server "$build/portolan-server" "$output" "$output/server.log" "$@"
  "$build/cli/portolan" settle --server "$address" --timeout_s 3600 > /dev/null
  "$build/cli/portolan" export tum --server "$address" --all_frames \
    --out "$output/trajectories" > /dev/null
  stop_server
  local estimates=()
  for file in "$output"/trajectories/*.tum; do estimates+=(--estimate "$file"); done
  "$build/cli/portolan" evaluate "${estimates[@]}" --groundtruth "$groundtruth" --align sim3 --json |
    sed -E 's/.*"joint": \{[^}]*"ate_m": \{"count": [0-9]+, "rmse": ([-0-9.e+]+).*/\1/'
}

printf '%-40s %8s %8s %8s\n' mission live rebuilt change
for folder in "$@"; do
  ate_m "$folder" > "$output.live"
  ate_m "$folder" --rebuild > "$output.rebuilt"
  awk -v name="$(basename "$folder")" -v live="$(cat "$output.live")" \
    -v rebuilt="$(cat "$output.rebuilt")" \
    'BEGIN { printf "%-40s %8.2f %8.2f %+7.1f%%\n", name, 1000 * live, 1000 * rebuilt,
             100 * (rebuilt / live - 1) }'
done
