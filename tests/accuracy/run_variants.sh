#!/usr/bin/env bash
# The real sequences as nobody has tuned for them: backwards, with every second and every third
# frame, and begun after a third of their frames. Prints the ATE in mm (RMSE of the final map's
# frames in lockstep, after a Sim(3) alignment) and, if they are not one and all, in brackets the
# number of parts and the share of the images that are in the map.
#
#   tests/accuracy/run_variants.sh [WORD] [-- agent flags]    sequences of $PORTOLAN_DATA
#                                                  (../shared/data) whose name contains the word
set -euo pipefail
. "$(dirname "$0")/arguments.sh"
output=out/variants
deploy/build.sh "${PORTOLAN_PRESET:-release}" portolan-agent portolan-server portolan > /dev/null

# name | sequence | ground truth
sequences="
redkitchen|7scenes/redkitchen_seq-01|groundtruth.txt
MH_01|euroc/MH_01_easy_first18s|groundtruth.txt
scenelib|monoslam_davison/scenelib_test_sequence|reference_sfm.txt
checkerboard_desk|uzh_vamr/checkerboard_desk|groundtruth.txt
desk_translation|openekf/desk_translation|reference_sfm.txt
kitti 00|kitti/odometry_00_first200|groundtruth.txt
"

# Seconds and file of every image.
images_of() {
  if [ -f "$1/times.txt" ]; then
    grep -v '^#' "$1/times.txt" | awk 'NF'
  else
    grep -v '^#' "$1/data.csv" | tr -d '\r' |
      awk -F, 'NF {printf "%s.%s images/%s\n", substr($1, 1, length($1) - 9),
                   substr($1, length($1) - 8), $2}'
  fi
}

# make FOLDER VARIANT SEQUENCE TRUTH
make() {
  local folder="$1" variant="$2" sequence="$3" truth="$4" count sum
  rm -rf "$folder"
  mkdir -p "$folder/images"
  cp "$sequence/calib.yaml" "$folder/"
  images_of "$sequence" > "$folder/all.txt"
  count="$(wc -l < "$folder/all.txt")"
  sum="$(awk 'NR == 1 {first = $1} {last = $1} END {printf "%.6f", first + last}' "$folder/all.txt")"
  grep -v '^#' "$sequence/$truth" > "$folder/groundtruth.txt"
  case "$variant" in
    backwards)
      tac "$folder/all.txt" | awk -v sum="$sum" '{printf "%.6f %s\n", sum - $1, $2}'
      tac "$folder/groundtruth.txt" |
        awk -v sum="$sum" '{$1 = sprintf("%.6f", sum - $1); print}' > "$folder/turned.txt"
      mv "$folder/turned.txt" "$folder/groundtruth.txt"
      ;;
    second) awk 'NR % 2 == 1' "$folder/all.txt" ;;
    third) awk 'NR % 3 == 1' "$folder/all.txt" ;;
    late) awk -v from="$((count / 3))" 'NR > from' "$folder/all.txt" ;;
  esac | while read -r time file; do
    i=$((${i:--1} + 1))
    image="images/$(printf %06d "$i").${file##*.}"
    ln -s "$sequence/$file" "$folder/$image"
    echo "$time $image"
  done > "$folder/times.txt"
  rm "$folder/all.txt"
}

printf "%-20s%22s%22s%22s%22s\n" sequence backwards "every second" "every third" "from a third"
while IFS='|' read -r name sequence truth; do
  if [ -z "$name" ] || [[ "$name" != *"$word"* ]]; then continue; fi
  if [ ! -d "$data/$sequence" ]; then
    echo "NO DATA: $data/$sequence"
    continue
  fi
  printf "%-20s" "$name"
  for variant in backwards second third late; do
    folder="$output/${name%% *}_$variant"
    make "$folder" "$variant" "$data/$sequence" "$truth"
    PORTOLAN_LOCKSTEP=1 deploy/mission.sh "$folder/run" "a=$folder" -- "$@" > "$folder/log.txt" 2>&1 \
      < /dev/null || { printf "%22s" FAILED; continue; }
    ate="$("$build/server/cli/portolan" evaluate --estimate "$folder/run/final/a.tum" \
      --groundtruth "$folder/groundtruth.txt" --align sim3 |
      awk -F'|' '/all agents/ && !done {split($2, a, " "); printf "%.1f", 1000 * a[1]; done = 1}')"
    parts="$(awk '$1 == "components" {print $2}' "$folder/run/info.txt")"
    share="$(cat "$folder/run/final/a.tum" "$folder/times.txt" |
      awk '/^#/ {next} /images/ {images++; next} {poses++} END {printf "%.2f", poses / images}')"
    if [ "$parts" != 1 ] || [ "$share" != 1.00 ]; then ate="$ate ($parts, $share)"; fi
    printf "%22s" "$ate"
  done
  echo
done <<< "$sequences"
