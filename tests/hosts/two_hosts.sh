#!/bin/sh
# Runs a simulator on one host, and a watch on another one: two network namespaces, each with its
# own /dev/shm and /tmp/iceoryx2, joined by a tunnel.
#
#     two_hosts.sh FOLDER one|two SIMULATOR [SECONDS]
#
# FOLDER gets watch.out, watch.err and sim.out. `one` runs both on one host, for comparison. XX Started by tests/hosts/main.rs in namespaces of its own.
set -eu
folder=$1 hosts=$2 simulator=$3
shift 3

private_memory='mkdir -p /tmp/iceoryx2
mount -t tmpfs tmpfs /dev/shm
mount -t tmpfs tmpfs /tmp/iceoryx2
ip link set lo up'
sh -c "$private_memory"

watch() { "$@" "$LINKWATCH" watch --json >"$folder/watch.out" 2>"$folder/watch.err" & }

if [ "$hosts" = one ]; then
    watch env
else
    unshare --net --mount sleep 600 &
    other=$!
    on_other() { nsenter --net --mount --target "$other" "$@"; }
    # The namespaces exist once the process has other ones than this shell.
    until [ "$(readlink "/proc/$other/ns/net")" != "$(readlink /proc/self/ns/net)" ]; do
        sleep 0.01
    done
    sleep 0.1
    ip link add name near type veth peer name far netns "$other"
    ip addr add 10.77.0.1/24 dev near
    ip link set near up
    on_other sh -c "$private_memory
        ip addr add 10.77.0.2/24 dev far
        ip link set far up"
    tunnel() {
        config=$folder/$1.json5
        echo "{ mode: \"peer\", $2: { endpoints: [\"tcp/10.77.0.1:7447\"] }," \
            "scouting: { multicast: { enabled: false } } }" >"$config"
        shift 2
        "$@" "$TUNNEL" --poll 1 -z "$config" >/dev/null 2>&1 &
    }
    tunnel here listen env
    tunnel there connect on_other
    watch on_other
    if [ $# -gt 0 ]; then
        (
            sleep "$1"
            ip link set near down
        ) &
    fi
fi

code=0
sh -c "$simulator" >"$folder/sim.out" 2>&1 || code=$?
# The watch ends with its simulator.
for _ in $(seq 100); do
    [ -s "$folder/watch.out" ] && grep -q summary "$folder/watch.out" && break
    sleep 0.1
done
exit "$code"
