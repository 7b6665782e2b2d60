#!/usr/bin/env bash
# Runs one mission on this machine: a server, an agent a sequence, then the map's products.
#
#   deploy/mission.sh OUTPUT_FOLDER NAME=SEQUENCE[:START-END] ... [-- agent flags]
#
# START and END are frame numbers, both included. Leaves in OUTPUT_FOLDER: map.db, the agents'
# trajectories (agents/NAME/*.tum, live and corrected as each agent knew them), the final map's
# trajectories of all frames (final/NAME.tum), map.ply and the logs. The build preset is taken from
# PORTOLAN_PRESET (release). With PORTOLAN_LOCKSTEP=1 the server takes the submaps in a fixed order,
# which makes the map repeatable, and takes longer.
set -euo pipefail

root="$(cd "$(dirname "$0")/.." && pwd)"
build="$root/build/${PORTOLAN_PRESET:-release}"
output="${1:?usage: deploy/mission.sh OUTPUT_FOLDER NAME=SEQUENCE[:START-END] ... [-- agent flags]}"
shift

specs=()
agent_flags=()
while [ "$#" -gt 0 ]; do
  if [ "$1" = -- ]; then
    shift
    agent_flags=("$@")
    break
  fi
  specs+=("$1")
  shift
done
if [ "${#specs[@]}" -eq 0 ]; then
  echo "error: no NAME=SEQUENCE given" >&2
  exit 2
fi

rm -rf "$output"
mkdir -p "$output/agents" "$output/final" "$output/logs"

. "$root/deploy/local_server.sh"

names=()
for spec in "${specs[@]}"; do names+=("${spec%%=*}"); done
lockstep=()
if [ -n "${PORTOLAN_LOCKSTEP:-}" ]; then
  lockstep=(--lockstep --lockstep-agents "$(IFS=,; echo "${names[*]}")")
fi

start_server "$build/server/portolan-server" "$output" "$output/logs/server.log" "${lockstep[@]}"
echo "$address" > "$output/address"

agents=()
for spec in "${specs[@]}"; do
  name="${spec%%=*}"
  sequence="${spec#*=}"
  range=()
  if [[ "$sequence" =~ ^(.*):([0-9]+)-([0-9]+)$ ]]; then
    sequence="${BASH_REMATCH[1]}"
    range=(--start "${BASH_REMATCH[2]}" --end "${BASH_REMATCH[3]}")
  fi
  "$build/agent/portolan-agent" "$sequence" --agent "$name" --server "$address" \
    --outbox "$output/agents/$name/outbox" --output "$output/agents/$name" \
    --no-progress "${range[@]}" "${agent_flags[@]}" \
    > "$output/logs/agent_$name.log" 2>&1 &
  agents+=($!)
done
failed=0
for i in "${!agents[@]}"; do
  if ! wait "${agents[$i]}"; then
    echo "error: agent ${names[$i]} failed:" >&2
    tail -3 "$output/logs/agent_${names[$i]}.log" >&2
    failed=1
  fi
done
if [ "$failed" -ne 0 ]; then exit 1; fi

portolan=("$build/server/cli/portolan")
"${portolan[@]}" settle --server "$address" > /dev/null
"${portolan[@]}" info --server "$address" > "$output/info.txt"
"${portolan[@]}" info --server "$address" --json > "$output/info.json"
for name in "${names[@]}"; do
  "${portolan[@]}" trajectory --server "$address" --agent "$name" --all-frames \
    --out "$output/final/$name.tum"
done
"${portolan[@]}" export ply --server "$address" --out "$output/map.ply"
"${portolan[@]}" export png --server "$address" --out "$output/map.png"
