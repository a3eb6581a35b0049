#!/bin/sh
# Moving objects against the path tracer: pictures side by side, errors and frame times.  pictures.sh BUILD_DIR
# Every figure is of the `indirect` component over the pixels that show objects, unless it says otherwise.
set -eu
build=$1
out=$build/report
spp=${REPORT_SPP:-96}
mkdir -p "$out"
XDG_CACHE_HOME=$out/cache
export XDG_CACHE_HOME
if [ -z "${VK_DRIVER_FILES:-}" ]; then
    for file in /usr/share/vulkan/icd.d/lvp_icd*.json; do
        [ -e "$file" ] && VK_DRIVER_FILES=$file && export VK_DRIVER_FILES
    done
fi
number() { sed -n "s/.*\"$1\": *\({\"median\": *\)\{0,1\}\([-0-9.e+]*\).*/\2/p" "$2"; }
median() { sort -g | awk '{ v[NR] = $1 } END { print NR % 2 ? v[(NR + 1) / 2] : (v[NR / 2] + v[NR / 2 + 1]) / 2 }'; }
scene() { [ -e "$out/$1.glb" ] || "$build/bin/chiaro-scene" "$1" -o "$out/$1.glb"; }

# Renders and traces a scene; the reference takes `spp` paths a pixel. picture NAME SCENE.glb options ...
picture() {
    name=$1 file=$2
    shift 2
    for component in full indirect; do
        "$build/bin/chiaro-render" "$file" -o "$out/$name.$component.exr" --component $component "$@" --quiet
    done
    "$build/bin/chiaro-reference" "$file" --all "$out/$name.reference" --mask-out "$out/$name.mask.exr" --spp "$spp" \
        --component indirect --json --quiet "$@" > "$out/$name.reference.json"
    "$build/bin/chiaro-sheet" -o "$out/$name.png" "$out/$name.full.exr" "$out/$name.reference.full.exr" \
        "$out/$name.indirect.exr" "$out/$name.reference.indirect.exr"
    compare() { "$build/bin/chiaro-compare" "$out/$name.indirect.exr" "$out/$name.reference.indirect.exr" "$@" --json; }
    compare --mask "$out/$name.mask.exr" > "$out/$name.objects.json"
    compare > "$out/$name.whole.json"
}

# One line of figures. tell NAME what
tell() {
    printf '%-22s: relRMSE %.4f, mean ratio %.4f; whole picture %.4f, %.4f; noise of the reference %.4f; %s\n' "$2" \
        "$(number relrmse "$out/$1.objects.json")" "$(number mean_ratio "$out/$1.objects.json")" \
        "$(number relrmse "$out/$1.whole.json")" "$(number mean_ratio "$out/$1.whole.json")" \
        "$(number noise_indirect "$out/$1.reference.json")" "$out/$1.png"
}

# An object in places of a scene, each with an eye that sees it. carry NAME SCENE.glb sphere|box place/eye ... -- options ...
carry() {
    carried=$1-$3 file=$2 object=$3 places= k=0
    shift 3
    while [ "$1" != -- ]; do
        places="$places $1"
        shift
    done
    shift
    for at in $places; do
        k=$((k + 1)) place=${at%/*}
        picture "$carried-$k" "$file" --add "$object,$place,0.7" --eye "${at#*/}" --target "$place" --fov 16 --size 128x128 "$@"
        number relrmse "$out/$carried-$k.objects.json"
    done > "$out/$carried.txt"
    for k in $(seq "$k"); do
        [ "$(number pixels "$out/$carried-$k.objects.json")" -gt 0 ] || { echo "$carried-$k is not seen" >&2; exit 1; }
        number relrmse "$out/$carried-$k.whole.json"
    done > "$out/$carried.whole.txt"
    printf '%-22s: %d places: median relRMSE %.4f, worst %.4f; whole pictures %.4f, %.4f; %s\n' "$carried" "$k" \
        "$(median < "$out/$carried.txt")" "$(sort -g "$out/$carried.txt" | tail -n 1)" "$(median < "$out/$carried.whole.txt")" \
        "$(sort -g "$out/$carried.whole.txt" | tail -n 1)" "$out/$carried-*.png"
}

# A level of one's own: SCENE=file.glb PLACES='x,y,z/x,y,z ...' (of the object, of the eye) OPTIONS='--light ...'
if [ -n "${SCENE:-}" ] && [ -n "${PLACES:-}" ]; then
    level=$(basename "$SCENE") # `name` is that of a picture
    for object in sphere box; do
        carry "${level%.*}" "$SCENE" $object $PLACES -- ${OPTIONS:-}
    done
    exit
fi

scene spheres
scene cornell
scene two-rooms
set -- --dynamic 'sphere_*' --sky 0.6,0.75,1 --sun 1,2,1,3,2.8,2.5
picture spheres "$out/spheres.glb" --size 384x384 "$@"
tell spheres spheres
box=2.8,5.3,-1.2 # above its blocks
rooms="1,0.5,1/0.3,2.7,4.7 2.5,0.5,2.5/0.3,2.7,4.7 4.2,0.6,2.5/0.3,2.7,4.7 4,0.4,4.3/0.3,2.7,4.7
    6.2,0.5,2.5/9.9,2.7,0.3 7.2,0.5,2.5/9.9,2.7,0.3 8.6,0.5,3.6/9.9,2.7,0.3 6,1.2,1/9.9,2.7,4.7"
for object in sphere box; do
    carry cornell "$out/cornell.glb" $object 1.0,0.6,4.6/$box 1.2,1.6,4.2/$box 2.8,4.0,2.0/$box 4.6,1.0,1.2/$box \
        1.9,2.4,1.6/$box 0.8,3.5,2.6/$box 4.4,4.4,4.6/$box 2.8,3.0,0.8/$box --
    carry two-rooms "$out/two-rooms.glb" $object $rooms --
done
spp=$((4 * spp)) # little light finds the door
picture two-rooms "$out/two-rooms.glb" --size 256x256 --add box,7.2,0.5,2.5,0.8 --add sphere,8.6,1.2,3.6,0.7
tell two-rooms 'two-rooms, dark one'

# Pairs with and without bounce light, so that a noisy machine spoils neither alone.
for pair in 1 2 3 4 5; do
    for gi in on off; do
        "$build/bin/chiaro-render" "$out/spheres.glb" -o "$out/timed.exr" --frames 40 --sway 0.3 --cubes 8 --gi $gi --json \
            "$@" > "$out/$gi.json"
    done
    awk "BEGIN { print $(number frame_ms "$out/on.json") / $(number frame_ms "$out/off.json") }"
done > "$out/ratios.txt"
printf '100 moving objects    : 8 cubes a frame, 512x512: frame %.1f ms, without bounce light %.1f ms, median ratio of 5 pairs %.2f; %d bytes of cubes an object\n' \
    "$(number frame_ms "$out/on.json")" "$(number frame_ms "$out/off.json")" "$(median < "$out/ratios.txt")" \
    "$(($(number cube_bytes "$out/on.json") / 100))"
rm -f "$out/timed.exr"
