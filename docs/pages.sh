#!/usr/bin/env bash
# Draws the pictures of report pages in the documentation: docs/*-page.png.
# Needs loadtwin on the PATH, chromium and Pillow (target/venv has it, with matplotlib). Run it in the root of the clone.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

picture() { # PAGE HEIGHT PICTURE [WIDTH]
    screenshot "file://$1#theme=light" "$2" "$3" "${4:-900}" --virtual-time-budget=5000
}

screenshot() { # ADDRESS HEIGHT PICTURE WIDTH WAITING
    chromium --headless --no-sandbox --disable-gpu --hide-scrollbars --user-data-dir="$folder/profile" \
        "$5" --window-size="$4,$2" --screenshot="$folder/page.png" "$1" 2>"$folder/log"
    # Below 100 kB.
    python3 -c 'import sys; from PIL import Image; Image.open(sys.argv[2]).convert("RGB").quantize(64).save(sys.argv[1], optimize=True)' \
        "$3" "$folder/page.png"
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

# The pages of a calibration, a tuning, a rotor, a bearing, a life, a drive, the paper's tables and a fleet.
cd "$docs/.."
simulate() { loadtwin simulate "$@" >>"$folder/log"; }
simulate examples/gearbox/machine.toml --scenario constant --seed 2 --individual 1 --effect paper -o "$folder/constant.parquet"
simulate examples/gearbox/machine.toml --scenario torque-ramps --seed 2 --individual 1 --effect paper -o "$folder/ramps.parquet"
loadtwin calibrate examples/gearbox/machine.toml "$folder/constant.parquet" "$folder/ramps.parquet" \
    -o "$folder/my-gearbox.toml" --report "$folder/calibrate.html" >>"$folder/log"
loadtwin tune examples/gearbox/calibrated.toml "$folder/constant.parquet" "$folder/ramps.parquet" --sensors torque-arm-3 \
    -o "$folder/tuned.toml" --compare --report "$folder/tune.html" >>"$folder/log"
simulate examples/rotor/machine.toml --duration-s 4 --seed 1 -o "$folder/rotor.parquet"
loadtwin replay examples/rotor/machine.toml "$folder/rotor.parquet" --report "$folder/rotor.html" >>"$folder/log"
simulate examples/bearing/calibrated.toml --scenario lc1 --duration-s 15 --seed 2 --individual 101 -o "$folder/lc1.parquet"
loadtwin replay examples/bearing/calibrated.toml "$folder/lc1.parquet" --report "$folder/bearing.html" >>"$folder/log"
loadtwin replay examples/gearbox/machine.toml examples/gearbox/start-stop.parquet --estimates "$folder/estimates.parquet" \
    >>"$folder/log"
loadtwin life "$folder/estimates.parquet" --exponents 3,9 -o "$folder/counts.parquet" --report "$folder/life.html" >>"$folder/log"
for seed in 1 2; do
    simulate examples/feed-drive/plant.toml --scenario reversals --duration-s 40 --individual 1 --seed $seed \
        --effect coulomb-friction=3 -o "$folder/drive-$seed.csv"
done
loadtwin diagnose examples/feed-drive/drive.toml "$folder/drive-1.csv" --report "$folder/drive.html" >>"$folder/log"
loadtwin tables --individuals 1 --report "$folder/tables.html" >>"$folder/log"
for page in calibrate tune rotor bearing life drive tables; do
    picture "$folder/$page.html" 1240 "$docs/$page-page.png" 1100
done

# Three machines with three days of 20 s each; the second has a gauge that lost a part of its response.
for machine in 1 2 3; do
    for day in 1 2 3; do
        recording="$folder/archive/recordings/machine=gearbox-$machine/day=2026-11-0$day"
        mkdir -p "$recording"
        effect=$([ $machine = 2 ] && echo "--effect gain-error=5" || true)
        simulate examples/gearbox/machine.toml --scenario turbulent --duration-s 20 --seed $machine$day $effect \
            -o "$recording/rec.parquet"
    done
    echo "gearbox-$machine,2026-01-01,$PWD/examples/gearbox/machine.toml"
done | sed '1i machine,from,description' >"$folder/descriptions.csv"
mv "$folder/descriptions.csv" "$folder/archive/"
loadtwin replay --archive "$folder/archive" -o "$folder/results" >>"$folder/log"
picture "$folder/results/page/index.html" 420 "$docs/fleet-page.png" 1300

# A bus in the browser, its log twice as fast as it was recorded.
simulate examples/bench/machine.toml --scenario torque-ramps --duration-s 30 --seed 4 -o "$folder/bench.parquet"
loadtwin send examples/bench/machine.toml "$folder/bench.parquet" --log "$folder/raw.log" >>"$folder/log"
loadtwin node examples/bench/machine.toml "$folder/raw.log" -o "$folder/bus.log" >>"$folder/log"
loadtwin monitor "$folder/bus.log" examples/bench/machine.toml --web 18080 --speed 2 >>"$folder/log" 2>&1 &
server=$!
sleep 6
screenshot http://127.0.0.1:18080/ 900 "$docs/monitor-page.png" 1100 --timeout=3000
kill "$server"
