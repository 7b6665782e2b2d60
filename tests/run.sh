#!/usr/bin/env bash
# Installs what is missing, builds and runs the tests.
#   tests/run.sh                 all tests, release build
#   tests/run.sh asan|tsan|debug the unit tests in that preset
#   tests/run.sh PRESET LABEL    only tests with that label (unit, end_to_end, accuracy)
set -euo pipefail

root="$(cd "$(dirname "$0")/.." && pwd)"
preset="${1:-release}"
label="${2:-}"
if [ -z "$label" ] && [ "$preset" != release ]; then
  label=unit
fi
cd "$root"
if [ "$label" = unit ]; then
  deploy/build.sh "$preset" unit_tests
else
  deploy/build.sh "$preset" all_tests
fi
export OMP_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1
export TSAN_OPTIONS="suppressions=$root/tests/support/tsan.supp ${TSAN_OPTIONS:-}"
ctest --preset "$preset" -j2 ${label:+-L "$label"}
