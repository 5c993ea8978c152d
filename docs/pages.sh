#!/usr/bin/env bash
# Draws the pictures of report pages in the documentation: docs/replay-page.png and docs/diagnose-page.png.
# Needs loadtwin on the PATH, chromium and Pillow (target/venv has it, with matplotlib). Run it in the root of the clone.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

picture() { # PAGE HEIGHT PICTURE
    chromium --headless --no-sandbox --disable-gpu --hide-scrollbars --user-data-dir="$folder/profile" \
        --virtual-time-budget=5000 --window-size="900,$2" --screenshot=page.png "file://$1#theme=light" 2>"$folder/log"
    # Below 100 kB.
    python3 -c 'import sys; from PIL import Image; Image.open("page.png").convert("RGB").quantize(64).save(sys.argv[1], optimize=True)' \
        "$3"
}

cp -r examples/gearbox examples/bench "$folder"
docs=$PWD/docs
cd "$folder"
loadtwin replay gearbox/calibrated.toml gearbox/start-stop.parquet --sensors ring-gear-5 --report replay.html
picture "$folder/replay.html" 1240 "$docs/replay-page.png"

sed 's/^rate_hz = 2000/rate_hz = 500/' bench/machine.toml >bench.toml
loadtwin simulate bench.toml --scenario reversals --duration-s 20 --seed 1 --effect gauge-creep -o fit.parquet
loadtwin simulate bench.toml --scenario start-stop --duration-s 30 --seed 2 --effect gauge-creep -o validate.parquet
loadtwin diagnose bench.toml fit.parquet --validate validate.parquet --report diagnose.html >diagnose.txt
picture "$folder/diagnose.html" 1180 "$docs/diagnose-page.png"
