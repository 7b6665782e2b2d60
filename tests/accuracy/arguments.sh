# Sourced by the tables over real sequences: reads "[WORD] [-- agent flags]" from the positional
# parameters, of which the flags are left, and sets root folder, $data, $build and $word.
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
data="$(realpath -m "${PORTOLAN_DATA:-../shared/data}")"
build="build/${PORTOLAN_PRESET:-release}"
word=""
if [ "$#" -gt 0 ] && [ "$1" != -- ]; then
  word="$1"
  shift
fi
if [ "${1:-}" = -- ]; then shift; fi
if [ ! -d "$data" ]; then
  echo "NO DATA: set PORTOLAN_DATA to the folder of the real sequences" >&2
  exit 1
fi
