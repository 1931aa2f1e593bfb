#!/bin/sh
# Measures 1,000 instances of two octrees, and draws those of one.
#   ESVO_SCENES=FOLDER instances.sh WORK
# WORK: a folder for octrees. Run it in the root of the repository.
set -e
work=$1
here=results/2026-11-26-instances
cargo build --release
cargo build --release -p esvo-engines --features wgpu,ash --example instances
esvo=target/release/esvo
measure=target/release/examples/instances
$esvo build "$ESVO_SCENES/flight-helmet/FlightHelmet.gltf" -o "$work/helmet.esvo" --levels 9
$esvo build --scene conference -o "$work/conference.esvo" --levels 12
for octree in helmet conference; do
    $measure "$work/$octree.esvo" --count 1000 --size 320x240 --frames 3
done
$measure "$work/helmet.esvo" --list "$work/list.toml"
$esvo render "$work/list.toml" -o $here/helmets.png --size 400x300 --light sun:1,2,1.5 --camera=6,3.5,8,-6,-3.2,-8 --fov 50
