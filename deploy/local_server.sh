# Sourced by scripts that run a server of their own on this machine, which ends with them.

server=""
stop_server() {
  if [ -n "$server" ]; then
    kill "$server" 2> /dev/null || true
    wait "$server" 2> /dev/null || true
    server=""
  fi
}
trap stop_server EXIT

# start_server PROGRAM FOLDER LOG FLAGS...: with the map FOLDER/map.db; sets $address. The port is left
# in FOLDER/port. Ends the script, with the log, if the server does not listen.
start_server() {
  local program="$1" folder="$2" log="$3"
  shift 3
  rm -f "$folder/port"
  "$program" --map "$folder/map.db" --listen 127.0.0.1:0 --port-file "$folder/port" "$@" \
    > "$log" 2>&1 &
  server=$!
  while [ ! -s "$folder/port" ]; do
    if ! kill -0 "$server" 2> /dev/null; then
      cat "$log" >&2
      exit 1
    fi
    sleep 0.05
  done
  address="127.0.0.1:$(cat "$folder/port")"
}
