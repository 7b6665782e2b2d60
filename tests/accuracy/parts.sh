#!/usr/bin/env bash
# The agent's interchangeable parts on the same images, one table: every row changes one option of
# the default agent. Agents run alone, without a server, each as a process.
#
#   tests/accuracy/parts.sh            all parts
#   tests/accuracy/parts.sh matcher    those whose name contains the word, and the default
#
# Four figures a sequence: ATE of the odometry in mm (RMSE after one Sim(3)) / share of the frames
# that the ATE is of, the longest unbroken piece / CPU ms a frame of the whole process / landmarks
# that the filter was updated with, mean a frame. The ground truth is read by the evaluation only.
# Writes out/parts/table.md, too.
set -euo pipefail

root="$(cd "$(dirname "$0")/../.." && pwd)"
cd "$root"
data="${PORTOLAN_DATA:-../shared/data}"
build="build/${PORTOLAN_PRESET:-release}"
portolan="${PORTOLAN_CLI:-$build/server/cli/portolan}"
filter="${1:-}"
output=out/parts
if [ ! -d "$data" ]; then
  echo "NO DATA: set PORTOLAN_DATA to the folder of the real sequences" >&2
  exit 1
fi
rm -rf "$output"
mkdir -p "$output"

# name | folder | truth | first frame | last frame
sequences=(
  "MH_01|euroc/MH_01_easy_first18s|groundtruth.txt|0|359"
  "checkerboard_desk|uzh_vamr/checkerboard_desk|groundtruth.txt|0|735"
  "scenelib|monoslam_davison/scenelib_test_sequence|reference_sfm.txt|0|999"
  "redkitchen 0-302|7scenes/redkitchen_seq-01|groundtruth.txt|0|302"
)

# name | agent flags
parts=(
  "default: Shi-Tomasi, pyramidal LK, 1-point RANSAC, full update, undelayed inverse depth|"
  "detector Harris|--tracker.detector harris"
  "detector FAST|--tracker.detector fast"
  "detector ORB|--tracker.detector orb"
  "detector SIFT|--tracker.detector sift"
  "matcher active-search NCC|--tracker.matcher search"
  "outliers JCBB|--filter.inlier_selection joint_compatibility"
  "outliers chi-square only|--filter.inlier_selection chi_square"
  "covariance update compressed|--filter.covariance_update compressed"
  "initialisation two-view DLT|--initialization.method two_view"
  "initialisation multi-view LM|--initialization.method multi_view"
  "initialisation Chen's update|--initialization.method two_view_update"
)

value_of() {  # KEY FILE
  grep -o "\"$1\": [-0-9.e+]*" "$2" | awk '{print $2}'
}

# One cell: figures_of NAME FOLDER TRUTH START END FLAGS...
figures_of() {
  local name="$1" sequence="$data/$2" truth="$3" start="$4" end="$5"
  shift 5
  if [ ! -d "$sequence" ]; then
    echo "no data"
    return
  fi
  local run="$output/${name//[^A-Za-z0-9]/_}"
  rm -rf "$run"
  if ! "$build/agent/portolan-agent" "$sequence" --agent a --server none --session 1 \
    --outbox "$run/outbox" --output "$run" --start "$start" --end "$end" --no-progress \
    --log_level error "$@" > "$run.log" 2>&1; then
    echo "failed"
    return
  fi
  local poses ate share
  poses="$(grep -vc '^#' "$run/odometry.tum" || true)"
  ate="-"
  if [ "$poses" -gt 3 ]; then
    ate="$("$portolan" evaluate --estimate "$run/odometry.tum" --groundtruth "$sequence/$truth" \
      --align sim3 | awk '/all agents/ {split($0, p, "|"); split(p[2], a, " ");
                          printf "%.1f", 1000 * a[1]}')"
  fi
  share="$(awk -v n="$poses" -v of="$(value_of frames "$run/summary.json")" \
    'BEGIN {printf "%.2f", n / of}')"
  printf '%s / %s / %.1f / %.0f' "$ate" "$share" "$(value_of cpu_ms_per_frame "$run/summary.json")" \
    "$(value_of landmarks_per_frame "$run/summary.json")"
}

{
  header="| Part |"
  rule="|---|"
  for sequence in "${sequences[@]}"; do
    header="$header ${sequence%%|*} |"
    rule="$rule---|"
  done
  echo "$header"
  echo "$rule"
  for part in "${parts[@]}"; do
    name="${part%%|*}"
    if [[ "$name" != *"$filter"* && "$name" != default* ]]; then continue; fi
    read -r -a flags <<< "${part#*|}"
    row="| $name |"
    for sequence in "${sequences[@]}"; do
      IFS='|' read -r title folder truth start end <<< "$sequence"
      row="$row $(figures_of "$title $name" "$folder" "$truth" "$start" "$end" "${flags[@]}") |"
    done
    echo "$row"
  done
} | tee "$output/table.md"
