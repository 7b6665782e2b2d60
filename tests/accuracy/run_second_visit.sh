#!/usr/bin/env bash
# What an agent gains live from a map that is there already: on one server the first half of a
# sequence, then, by another agent, the second half in real time.
#
#   tests/accuracy/run_second_visit.sh [WORD] [-- agent flags]    sequences of $PORTOLAN_DATA
#                                                   (../shared/data) whose name contains the word
#   PORTOLAN_SEEDS=3 tests/accuracy/run_second_visit.sh           with three seeds of the RANSAC
#
# One line a run: live ATE in mm of the second agent (RMSE after its own Sim(3) alignment) and how
# many poses that is of (those in the common map); kB/s down to it; CPU ms a frame of its process;
# frames that it dropped because the machine was busy (a line with many does not count).
set -euo pipefail
. "$(dirname "$0")/arguments.sh"
. deploy/local_server.sh
output=out/second_visit

# name | sequence | ground truth | first half | second half
sequences="
redkitchen|7scenes/redkitchen_seq-01|groundtruth.txt|0 454|455 909
scenelib|monoslam_davison/scenelib_test_sequence|reference_sfm.txt|0 499|500 999
checkerboard_desk|uzh_vamr/checkerboard_desk|groundtruth.txt|0 367|368 735
MH_01|euroc/MH_01_easy_first18s|groundtruth.txt|0 179|180 359
"


visit() {  # NAME SEQUENCE START END FLAGS...
  local name="$1" sequence="$2" start="$3" end="$4"
  shift 4
  "$build/agent/portolan-agent" "$data/$sequence" --start "$start" --end "$end" --agent "$name" \
    --server "$address" --outbox "$output/$name/outbox" \
    --output "$output/$name" --no-progress "$@" > "$output/$name.log" 2>&1
}

figure() { grep -o "\"$1\": [-0-9.e+]*" "$output/second/summary.json" | awk '{print $2}'; }

printf '%-20s %4s %8s %9s %8s %7s %8s\n' sequence seed 'live mm' poses 'dn kB/s' 'cpu ms' dropped
while IFS='|' read -r name sequence truth first second; do
  if [ -z "$name" ] || [[ "$name" != *"$word"* ]]; then continue; fi
  if [ ! -d "$data/$sequence" ]; then
    printf '%-20s NO DATA: %s\n' "$name" "$data/$sequence"
    continue
  fi
  for seed in $(seq "${PORTOLAN_SEEDS:-1}"); do
    rm -rf "$output"
    mkdir -p "$output"
    start_server "$build/server/portolan-server" "$output" "$output/server.log"
    read -r -a range <<< "$first"
    visit first "$sequence" "${range[@]}" --filter.ransac_seed "$seed"
    read -r -a range <<< "$second"
    visit second "$sequence" "${range[@]}" --rate 1 --filter.ransac_seed "$seed" "$@"
    stop_server
    read -r live poses <<< "$("$build/server/cli/portolan" evaluate --align sim3 \
      --estimate "$output/second/live.tum" --groundtruth "$data/$sequence/$truth" |
      awk '/all agents/ && !done {
        n = split($0, parts, "|"); split(parts[1], a, " "); split(parts[2], b, " ");
        printf "%.1f %d", 1000 * b[1], a[3]; done = 1}')"
    printf '%-20s %4s %8s %9s %8s %7s %8s\n' "$name" "$seed" "$live" "$poses" \
      "$(figure received_kb_per_s)" "$(figure cpu_ms_per_frame)" "$(figure dropped_frames)"
  done
done <<< "$sequences"
