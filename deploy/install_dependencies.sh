#!/usr/bin/env bash
# Installs the Debian packages of dependencies.txt that are missing. Does nothing, quickly, when
# all are there. Needs root, or sudo, only if something is missing.
set -euo pipefail

list="$(cd "$(dirname "$0")" && pwd)/dependencies.txt"
missing=()
missing_optional=()
while read -r package kind; do
  case "$package" in ''|'#'*) continue ;; esac
  if dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed'; then
    continue
  fi
  if [ "$kind" = optional ]; then
    missing_optional+=("$package")
  else
    missing+=("$package")
  fi
done < "$list"

if [ "${#missing[@]}" -eq 0 ] && [ "${#missing_optional[@]}" -eq 0 ]; then
  exit 0
fi
as_root=()
if [ "$(id -u)" -ne 0 ]; then
  if command -v sudo > /dev/null; then
    as_root=(sudo)
  elif [ "${#missing[@]}" -gt 0 ]; then
    echo "error: run as root, or install these packages yourself: ${missing[*]}" >&2
    exit 1
  else
    echo "Missing, and not needed: ${missing_optional[*]}"
    exit 0
  fi
fi
install() {
  echo "Installing: $*"
  "${as_root[@]}" apt-get update -qq &&
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
      apt-get install -y -qq --no-install-recommends "$@" > /dev/null
}
if [ "${#missing[@]}" -gt 0 ]; then
  install "${missing[@]}"
fi
# Once: a machine without a network would wait for it at every build.
tried="$(dirname "$list")/../build/optional_packages_tried"
if [ "${#missing_optional[@]}" -gt 0 ] && [ ! -e "$tried" ]; then
  mkdir -p "$(dirname "$tried")"
  touch "$tried"
  install "${missing_optional[@]}" || echo "Not installed, and not needed: ${missing_optional[*]}" >&2
fi
