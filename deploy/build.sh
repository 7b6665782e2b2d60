#!/usr/bin/env bash
# Configures and builds one preset: deploy/build.sh PRESET [TARGET...]. Installs what is missing.
set -euo pipefail

root="$(cd "$(dirname "$0")/.." && pwd)"
preset="${1:?usage: deploy/build.sh PRESET [TARGET...]}"
shift
"$root/deploy/install_dependencies.sh"
cd "$root"
mkdir -p "build/$preset"
log="build/$preset/configure.log"
if ! cmake --preset "$preset" > "$log" 2>&1; then
  cat "$log" >&2
  exit 1
fi
targets=()
if [ "$#" -gt 0 ]; then
  targets=(--target "$@")
fi
cmake --build --preset "$preset" "${targets[@]}"
