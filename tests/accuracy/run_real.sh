#!/usr/bin/env bash
# Runs the whole system, server and agents as processes, on the real sequences and prints one
# table: coverage and ATE against the ground truth, which nothing else reads.
#
#   tests/accuracy/run_real.sh            all sequences of $PORTOLAN_DATA (../shared/data), and the
#                                         rendered loop of the demo
#   tests/accuracy/run_real.sh kitchen    those whose name contains the word
#   PORTOLAN_SEEDS=3 tests/accuracy/run_real.sh    medians over three seeds of the agents' RANSAC,
#                                         and the least and most final and live ATE
#
# Columns: frames; share of ground-truth stamps with an estimate; ATE (RMSE after one Sim(3)
# alignment of all agents together) of all frames in the final map of a run in lockstep; the ATE of
# what the agents knew live in a second run in real time, and its coverage (instants at which an
# agent had no place in the common map yet do not count); the ATE without the server: every agent's
# uncorrected odometry, each aligned alone (they have no common frame, so this flatters it);
# connected parts of the map; kB/s up and down an agent in the run in real time; CPU ms a frame of
# the agent's process.
# Rows with an IMU are aligned without scale, SE(3); their last column is the map's scale error.
set -euo pipefail

root="$(cd "$(dirname "$0")/../.." && pwd)"
cd "$root"
data="${PORTOLAN_DATA:-../shared/data}"
filter="${1:-}"
seeds="${PORTOLAN_SEEDS:-1}"
output=out/real
mkdir -p out
portolan="build/${PORTOLAN_PRESET:-release}/server/cli/portolan"

if [ ! -d "$data" ]; then
  echo "NO DATA: set PORTOLAN_DATA to the folder of the real sequences" >&2
  exit 1
fi
deploy/build.sh "${PORTOLAN_PRESET:-release}" portolan-agent portolan-server portolan \
  portolan-synthetic > /dev/null

# name | sequence | truth | frame ranges, one agent each | alignment (sim3) | agent flags
sequences="
redkitchen, 3 agents|7scenes/redkitchen_seq-01|groundtruth.txt|0-302 303-605 606-909
scenelib, 3 agents|monoslam_davison/scenelib_test_sequence|reference_sfm.txt|0-333 334-667 668-999
redkitchen|7scenes/redkitchen_seq-01|groundtruth.txt|0-909
MH_01|euroc/MH_01_easy_first18s|groundtruth.txt|0-359
MH_01, IMU|euroc/MH_01_easy_first18s|groundtruth.txt|0-359|se3|--source.imu
MH_01, IMU, 2 agents|euroc/MH_01_easy_first18s|groundtruth.txt|0-179 180-359|se3|--source.imu
MH_01, 2 agents|euroc/MH_01_easy_first18s|groundtruth.txt|0-179 180-359
checkerboard_desk|uzh_vamr/checkerboard_desk|groundtruth.txt|0-735
scenelib|monoslam_davison/scenelib_test_sequence|reference_sfm.txt|0-999
desk_translation|openekf/desk_translation|reference_sfm.txt|0-358
kitti 00|kitti/odometry_00_first200|groundtruth.txt|0-199
V1_01 stills|euroc/V1_01_easy_keyframes|groundtruth.txt|0-99
rendered, 3 agents|rendered|groundtruth.txt|agent0 agent1 agent2
"

# The demo's input.
render() {
  if [ -d out/synthetic/agent2 ]; then return; fi
  "build/${PORTOLAN_PRESET:-release}/tests/synthetic/portolan-synthetic" --out out/synthetic \
    --mission three_agents --format jpg > out/synthetic.log 2>&1
}

mean_of() {  # KEY FILE...: mean over the agents' summaries
  local key="$1"
  shift
  cat "$@" | grep -o "\"$key\": [-0-9.e+]*" | awk '{s += $2} END {if (NR) printf "%.1f", s / NR}'
}

# Joint ATE in mm, coverage and scale error in %, or "-" without an estimate:
# ate MODE ALIGNMENT ESTIMATES... -- TRUTH|TRUTHS...
ate() {
  local mode="$1"
  local alignment="$2"
  shift 2
  local files=() estimates=() references=()
  while [ "$1" != -- ]; do
    files+=("$1")
    shift
  done
  shift
  for i in "${!files[@]}"; do
    if [ "$(grep -vc '^#' "${files[$i]}" || true)" -le 3 ]; then continue; fi
    estimates+=(--estimate "${files[$i]}")
    if [ "$#" -gt 1 ]; then references+=(--groundtruth "${@:$((i + 1)):1}"); fi
  done
  if [ "$#" -eq 1 ]; then references=(--groundtruth "$1"); fi
  if [ "${#estimates[@]}" -eq 0 ]; then
    echo "-"
    return
  fi
  "$portolan" evaluate "${estimates[@]}" "${references[@]}" --align "$alignment" |
    awk -v mode="$mode" '
      /^one joint/ {joint = 1} /^each agent/ {joint = 0}
      mode == "joint" && joint && /all agents|\.tum/ && !done {
        n = split($0, parts, "|"); split(parts[1], a, " "); split(parts[2], b, " ");
        printf "%.1f %s %s", 1000 * b[1], a[length(a)], parts[n]; done = 1}
      mode == "alone" && !joint && /\.tum/ {
        split($0, parts, "|"); split(parts[1], a, " "); split(parts[2], b, " ");
        k = a[length(a) - 1]; s += k * b[1] * b[1]; m += k}
      mode == "alone" && joint && /all agents/ {
        split($0, parts, "|"); split(parts[1], a, " "); split(parts[2], b, " ");
        one = b[1]}
      END {if (mode == "alone") printf "%.1f", (m > 0 ? 1000 * sqrt(s / m) : 1000 * one)}'
}

# One line of figures of one row with one seed: measure SEED NAME SEQUENCE TRUTH RANGES ALIGNMENT FLAGS
measure() {
  local seed="$1" name="$2" sequence="$3" truth="$4" ranges="$5" alignment="${6:-sim3}"
  local extra=() specs=() final=() live=() odometry=() summaries=() live_summaries=() truths=()
  read -r -a extra <<< "${7:-}"
  extra+=(--filter.ransac_seed "$seed")
  local folder="$output/${name//[^A-Za-z0-9]/_}"
  if [ "$sequence" != rendered ]; then truths=("$data/$sequence/$truth"); fi
  local i=0 range
  for range in $ranges; do
    if [ "$sequence" = rendered ]; then
      specs+=("agent$i=out/synthetic/$range")
      truths+=("out/synthetic/$range/$truth")
    else
      specs+=("agent$i=$data/$sequence:$range")
    fi
    final+=("$folder/final/agent$i.tum")
    live+=("$folder.live/agents/agent$i/live.tum")
    odometry+=("$folder/agents/agent$i/odometry.tum")
    summaries+=("$folder/agents/agent$i/summary.json")
    live_summaries+=("$folder.live/agents/agent$i/summary.json")
    i=$((i + 1))
  done
  if ! { PORTOLAN_LOCKSTEP=1 deploy/mission.sh "$folder" "${specs[@]}" -- "${extra[@]}" &&
    deploy/mission.sh "$folder.live" "${specs[@]}" -- --rate 1 "${extra[@]}"; } > "$output.log" 2>&1; then
    echo FAILED
    return
  fi
  local final_mm coverage scale live_mm live_coverage alone_mm frames parts
  read -r final_mm coverage scale <<< "$(ate joint "$alignment" "${final[@]}" -- "${truths[@]}")"
  read -r live_mm live_coverage _ <<< "$(ate joint "$alignment" "${live[@]}" -- "${truths[@]}")"
  alone_mm="$(ate alone "$alignment" "${odometry[@]}" -- "${truths[@]}")"
  frames="$(cat "${summaries[@]}" | grep -o '"frames": [0-9]*' | awk '{s += $2} END {print s}')"
  parts="$(awk '/^components/ {print $2}' "$folder/info.txt")"
  if [ "$alignment" = sim3 ]; then scale=-; fi
  echo "$frames ${coverage:--} $final_mm $live_mm ${live_coverage:--} $alone_mm $parts" \
    "$(mean_of sent_kb_per_s "${live_summaries[@]}") $(mean_of received_kb_per_s "${live_summaries[@]}")" \
    "$(mean_of cpu_ms_per_frame "${summaries[@]}") ${scale:--}"
}

# The median of every column, then the range of the third and the fourth.
medians() {
  awk '
    {for (i = 1; i <= NF; ++i) value[i, NR] = $i; columns = NF}
    function sorted(column,   i, j, swap) {
      for (i = 1; i <= NR; ++i) list[i] = value[column, i]
      for (i = 1; i <= NR; ++i) for (j = i + 1; j <= NR; ++j)
        if (list[j] + 0 < list[i] + 0) {swap = list[i]; list[i] = list[j]; list[j] = swap}
    }
    END {
      for (i = 1; i <= columns; ++i) {sorted(i); printf "%s ", list[int((NR + 1) / 2)]}
      for (i = 3; i <= 4; ++i) {sorted(i); printf "%s-%s ", list[1], list[NR]}
    }'
}

printf '%-20s %6s %8s %10s %9s %8s %10s %5s %8s %8s %7s %7s' sequence frames coverage 'final mm' \
  'live mm' coverage 'alone mm' parts 'up kB/s' 'dn kB/s' 'cpu ms' 'scale %'
if [ "$seeds" -gt 1 ]; then printf ' %15s %15s' 'final of seeds' 'live of seeds'; fi
printf '\n'
while IFS='|' read -r name sequence truth ranges alignment flags; do
  if [ -z "$name" ] || [[ "$name" != *"$filter"* ]]; then continue; fi
  if [ "$sequence" = rendered ]; then
    render
  elif [ ! -d "$data/$sequence" ]; then
    printf '%-20s NO DATA: %s\n' "$name" "$data/$sequence"
    continue
  fi
  lines=""
  for seed in $(seq "$seeds"); do
    line="$(measure "$seed" "$name" "$sequence" "$truth" "$ranges" "$alignment" "$flags" < /dev/null)"
    lines+="$line"$'\n'
  done
  if [[ "$lines" == *FAILED* ]]; then
    printf '%-20s FAILED, see %s\n' "$name" "$output.log"
    continue
  fi
  read -r -a row <<< "$(printf '%s' "$lines" | medians)"
  printf '%-20s %6s %8s %10s %9s %8s %10s %5s %8s %8s %7s %7s' "$name" "${row[@]:0:11}"
  if [ "$seeds" -gt 1 ]; then printf ' %15s %15s' "${row[@]:11}"; fi
  printf '\n'
done <<< "$sequences"
