#!/bin/sh
# Simulates models in the place of those of Table 1 of Qu & James 2021 that were not published, and
# writes them to a folder for `study table1 --models DIR` (benches/study). It takes about 10 minutes
# on two cores, and 2 GB of disk, which are free again at the end.
set -eu
dir=${1:?"usage: examples/table1.sh DIR"}
cargo build --release --bin linkwatch
cargo build --release -p yarn -p bands -p chainmail
bin=${CARGO_TARGET_DIR:-target}/release
run="$dir/run"
mkdir -p "$run"

# Simulates a scene, which ends with exit code 1 if its topology changes. That is not an error here.
simulate() {
    "$bin/$@" --service "table1-$$" --out "$run" || [ $? -eq 1 ]
}

# Writes one frame of the last simulation to a model file: RECORDING FRAME FILE.
keep() {
    "$bin/linkwatch" convert --force "$run/$1.mcap" "$dir/$3" --frame "$2"
}

simulate yarn tube --rows 39 --stitches 39 --turns 12 --substeps 2 --go-on
keep yarn 0 tube-39x39-initial.bcc
keep yarn 328 tube-39x39-final.bcc
simulate yarn tube --rows 32 --stitches 31 --frames 1
keep yarn 0 tube-32x31.bcc
simulate yarn garment --rows 126 --stitches 120 --frames 1
keep yarn 0 garment-126x120.bcc
simulate yarn garment --rows 274 --stitches 148 --frames 1
keep yarn 0 garment-274x148.bcc
simulate yarn garment --rows 73 --stitches 106 --substeps 8 --frames 61
keep yarn 0 garment-73x106-initial.bcc
keep yarn 60 garment-73x106-final.bcc
simulate bands --substeps 20
keep bands 119 bands-final.bcc
simulate chainmail --pack --side 69 --substeps 2 --frames 61 --go-on
keep chainmail 60 packed-69.bcc
rm -r "$run"
