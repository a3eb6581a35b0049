#!/bin/sh
# Runs every test program of a build and counts what they say: tests/run.sh BUILD_DIR [NAME]
# With a name, only those whose name begins with it.
# What is exact comes first, pictures last, so that the first failure is the one to read.
# The driver is always lavapipe, and no test finds what another one left in a cache.
set -u
cd "$(dirname "$0")/.." || exit 1
build=${1:?usage: tests/run.sh BUILD_DIR [NAME]}

driver=
for file in /usr/share/vulkan/icd.d/lvp_icd*.json; do
    [ -f "$file" ] && driver=$file
done
if [ -z "$driver" ]; then
    echo "tests: lavapipe is missing: no /usr/share/vulkan/icd.d/lvp_icd*.json (package mesa-vulkan-drivers)" >&2
    exit 1
fi
unset VK_ICD_FILENAMES VK_ADD_DRIVER_FILES
export VK_DRIVER_FILES="$driver"

# Sanitizers report what is ours: drivers and layers are left out, each by its name.
lists="$PWD/tests/sanitize"
export TSAN_OPTIONS="suppressions=$lists/thread.supp ${TSAN_OPTIONS:-}"
export LSAN_OPTIONS="suppressions=$lists/leak.supp print_suppressions=0 ${LSAN_OPTIONS:-}"
export UBSAN_OPTIONS="print_stacktrace=1 ${UBSAN_OPTIONS:-}"
if [ -f "$build/tests/keep_loaded.so" ]; then
    LD_PRELOAD=$(cd "$build/tests" && pwd)/keep_loaded.so
    export LD_PRELOAD ASAN_OPTIONS="verify_asan_link_order=0 ${ASAN_OPTIONS:-}"
fi

mkdir -p "$build/tests/out" build/tests/out || exit 1
work=$(mktemp -d "$build/tests/out/run.XXXXXX") || exit 1
work=$(cd "$work" && pwd)
trap 'rm -rf "$work"' EXIT
trap 'exit 1' INT TERM HUP

rank()
{
    case ${1##*/test_} in
    core | cube* | surface) echo 1 ;;
    reference*) echo 3 ;;
    bake*) echo 4 ;;
    vulkan* | image* | render* | embed* | view*) echo 5 ;;
    *) echo 2 ;;
    esac
}

# Sum of the counts in cmocka's lines "[  PASSED  ] 7 test(s)." of one program.
count()
{
    sed -n "s/^\[  $1 *\].* \([0-9][0-9]*\) test(s).*/\1/p" "$work/log" | awk '{ n += $1 } END { print n + 0 }'
}

for program in "$build"/tests/test_"${2:-}"*; do
    [ -f "$program" ] && [ -x "$program" ] && echo "$(rank "$program") $program"
done | LC_ALL=C sort > "$work/programs"

passed=0
failed=0
skipped=0
while read -r _ program; do
    rm -rf "$work/cache" && mkdir "$work/cache"
    echo "== ${program##*/}"
    begin=$(date +%s)
    { XDG_CACHE_HOME="$work/cache" "$program" < /dev/null 2>&1; echo $? > "$work/status"; } | tee "$work/log"
    good=$(count PASSED)
    bad=$(count FAILED)
    left=$(count SKIPPED)
    status=$(cat "$work/status")
    # A program that died, leaked, or ran nothing failed once, whatever it printed before.
    if [ "$bad" = 0 ] && { [ "$status" != 0 ] || [ $((good + left)) = 0 ]; }; then
        echo "== ${program##*/} ended with status $status after $good tests"
        bad=1
    fi
    echo "== ${program##*/}: $good passed, $bad failed, $(($(date +%s) - begin)) s"
    passed=$((passed + good))
    failed=$((failed + bad))
    skipped=$((skipped + left))
done < "$work/programs"

echo "$passed passed, $failed failed$([ "$skipped" = 0 ] || echo ", $skipped skipped")"
[ "$failed" = 0 ] && [ "$passed" != 0 ]
