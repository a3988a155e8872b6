#!/usr/bin/env bash
# Builds wheel and sdist, and tries them in clean environments: the wheel with the newest dependencies on every
# Python found, the sdist and the oldest allowed dependencies on the first one. Prints a line for each.
#
#   tests/packaging/run.sh [python3.11 python3.12 ...]     default: those of 3.11, 3.12, 3.13 that start
set -euo pipefail
cd "$(dirname "$0")/../.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 MPLBACKEND=Agg XDG_CACHE_HOME="$work/cache"
unset PYTHONPATH

found=()
for name in "${@:-python3.11 python3.12 python3.13}"; do
    for python in $name; do
        "$python" -c 'import sys' 2>/dev/null && found+=("$python")
    done
done
[ "${#found[@]}" -gt 0 ] || { echo "none of these Pythons starts: ${*:-3.11, 3.12, 3.13}" >&2; exit 1; }
first=${found[0]}

"$first" -m venv "$work/tools"
"$work/tools/bin/pip" install --quiet build uv twine
"$work/tools/bin/python" -m build --outdir "$work/dist" . >"$work/build.log" 2>&1 || { tail -20 "$work/build.log"; exit 1; }
"$work/tools/bin/twine" check --strict "$work"/dist/* >/dev/null
wheel=$(ls "$work"/dist/*.whl) sdist=$(ls "$work"/dist/*.tar.gz)
"$first" -c 'import sys, zipfile; sys.exit("inertiax/py.typed" not in zipfile.ZipFile(sys.argv[1]).namelist())' "$wheel" ||
    { echo "py.typed is not in the wheel" >&2; exit 1; }

attempt() { # label, python, what to install, more arguments of uv
    local start=$SECONDS label=$1 python=$2 what=$3
    shift 3
    "$python" -m venv "$work/venv"
    "$work/tools/bin/uv" pip install --quiet --python "$work/venv/bin/python" "$@" "$what"
    (cd "$work" && "$work/venv/bin/python" -W error::DeprecationWarning:inertiax "$OLDPWD/tests/packaging/smoke.py")
    printf '%-34s %-14s %4s s\n' "$label" "$("$python" -V)" "$((SECONDS - start))"
    rm -rf "$work/venv"
}

for python in "${found[@]}"; do
    attempt "wheel, newest dependencies" "$python" "$wheel"
done
attempt "sdist, newest dependencies" "$first" "$sdist"
attempt "wheel, oldest dependencies" "$first" "$wheel" --resolution lowest-direct
attempt "wheel with formats, oldest" "$first" "${wheel}[formats]" --resolution lowest-direct
