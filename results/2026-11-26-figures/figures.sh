#!/usr/bin/env bash
# Draws all pictures of this folder into the current one, with `esvo` from the path and the meshes of $ESVO_SCENES.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

# The octrees.
esvo build --scene sibenik-d -l 10 -o d10.esvo
esvo ambient d10.esvo -o d10a.esvo --rays 128 --radius 0.1
esvo build --scene sibenik -l 9 -o s9.esvo
esvo build --scene sibenik -l 10 --color-error 100 --normal-error 0.2 -o s10.esvo
esvo build --scene dragon -l 6 -o dragon.esvo
esvo build --scene flight-helmet -l 9 --color-error 60 --normal-error 0.2 --contour-error 9 -o helmet.esvo
awk -f "$here/drop.awk" > drop.obj
esvo build drop.obj -l 3 -o drop3.esvo
esvo build drop.obj -l 4 -o drop4.esvo

# Figure 1
nave="--scene sibenik-d --view 1"
esvo render d10a.esvo $nave --size 448x336 --light point:-10,-8,0 --light point:8,-5,0 --light point:12,5,0 -o figure-1.png
esvo render d10a.esvo $nave --size 448x336 --light sky -o figure-1-sky.png

# Figures 4 and 5
both="--compare no-contours+no-filter,contours+no-filter"
for l in 3 4; do
  esvo render drop$l.esvo --camera=0,0,60,0,0,-1,2.4 --size 400x320 --sky ffffff $both -o figure-4-$l-levels.png
done
esvo render dragon.esvo --size 360x288 $both -o figure-5.png

# Figure 9
iterations="$nave --size 288x216 --view-mode iterations"
esvo render d10.esvo $iterations --compare no-beam,beam -o figure-9.png
esvo render d10.esvo $iterations --compare cpu+beam,wgpu+beam -o figure-9-wgpu.png
esvo render d10.esvo $iterations --compare cpu,ash -o figure-9-ash.png

# Figure 10
close="--camera=0.12,0.58,0.32,-0.15,-0.05,-1,30 --size 360x288"
esvo render helmet.esvo $close --compare own-filter,filter -o figure-10.png
esvo render helmet.esvo $close --filter off -o figure-10-no-filter.png
esvo render helmet.esvo $close --view-mode voxel-size -o figure-10-voxel-size.png

# Figure 11's effect
for l in 9 10; do
  esvo render s$l.esvo --scene sibenik --view 2 --size 320x240 --compare no-filter,filter -o figure-11-nave-$l.png
done
esvo render s9.esvo --scene sibenik --view 2 --size 320x240 --compare wgpu+filter,cpu+filter -o figure-11-wgpu.png
esvo render s9.esvo --scene sibenik --view 2 --size 320x240 --compare ash+filter,cpu+filter -o figure-11-ash.png

# Films
esvo render helmet.esvo --turn --frames 120 --size 360x288 --sky dome -o turn.png
esvo render s10.esvo --path "$here/walk.txt" --frames 240 --size 320x240 -o walk.png
