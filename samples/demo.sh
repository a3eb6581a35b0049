#!/bin/sh
# The main job, start to end: bake a scene, render it on software Vulkan in three components, trace the truth, and put both
# side by side.  demo.sh BUILD_DIR [SCENE.gltf|SCENE.glb] [further scene options ...]
set -eu
build=$1
scene=${2:-}
[ $# -ge 2 ] && shift 2 || shift
out=$build/demo
size=${DEMO_SIZE:-512x512}
spp=${DEMO_SPP:-64}
mkdir -p "$out"
if [ -z "${VK_DRIVER_FILES:-}" ]; then
    for file in /usr/share/vulkan/icd.d/lvp_icd*.json; do
        [ -e "$file" ] && VK_DRIVER_FILES=$file && export VK_DRIVER_FILES
    done
fi
if [ -z "$scene" ]; then
    scene=$out/cornell.glb
    "$build/bin/chiaro-scene" cornell -o "$scene"
fi
number() { sed -n "s/.*\"$1\": *\({\"median\": *\)\{0,1\}\([-0-9.e+]*\).*/\2/p" "$2"; }

"$build/bin/chiaro-bake" "$scene" -o "$out/scene.chiaro" --json > "$out/bake.json"
# A scene without any light of its own gets a sky and a sun.
if [ $# -eq 0 ] && [ "$(number lights "$out/bake.json")" = 0 ] && [ "$(number emitters "$out/bake.json")" = 0 ]; then
    set -- --sky 1,1,1 --sun 1,2,1,3,3,3
fi
for component in full punctual indirect; do
    "$build/bin/chiaro-render" "$out/scene.chiaro" -o "$out/$component.exr" --size "$size" --component $component "$@" --quiet
done
"$build/bin/chiaro-render" "$out/scene.chiaro" -o "$out/full.png" --size "$size" "$@" --quiet
"$build/bin/chiaro-render" "$out/scene.chiaro" -o "$out/on.exr" --size "$size" --frames 20 --move-lights 0.1 --json "$@" > "$out/on.json"
"$build/bin/chiaro-render" "$out/scene.chiaro" -o "$out/off.exr" --size "$size" --frames 20 --move-lights 0.1 --gi off --json "$@" > "$out/off.json"
"$build/bin/chiaro-reference" "$scene" --all "$out/reference" --size "$size" --spp "$spp" --component indirect --json "$@" > "$out/reference.json"
"$build/bin/chiaro-sheet" -o "$out/sheet.png" "$out/full.exr" "$out/reference.full.exr" \
    "$out/punctual.exr" "$out/reference.punctual.exr" "$out/indirect.exr" "$out/reference.indirect.exr"
"$build/bin/chiaro-compare" "$out/indirect.exr" "$out/reference.indirect.exr" --json > "$out/compare.json"
rm -f "$out/on.exr" "$out/off.exr"
on=$(number frame_ms "$out/on.json") off=$(number frame_ms "$out/off.json")
printf '%s: indirect relRMSE %.4f (noise of the reference %.4f), mean ratio %.4f; frame with lights moving %.1f ms, without bounce light %.1f ms, ratio %.2f; bake %.1f s, %s KiB on the GPU\n' \
    "$scene" "$(number relrmse "$out/compare.json")" "$(number noise_relrmse "$out/reference.json")" \
    "$(number mean_ratio "$out/compare.json")" "$on" "$off" "$(awk "BEGIN { print $on / $off }")" \
    "$(number seconds "$out/bake.json")" "$(($(number gi_bytes "$out/on.json") / 1024))"
echo "pictures: $out/sheet.png (ours, reference, error; full, punctual, indirect), $out/full.png"
