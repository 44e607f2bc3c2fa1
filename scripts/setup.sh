#!/bin/sh
# Makes .venv ready: finds a Python, sees to system packages, installs what is pinned.
# scripts/setup.sh run    what the commands need (constraints-run.txt)
# scripts/setup.sh [all]  that, the window, the drivers' libraries, Mitsuba, tests and linters too (constraints.txt)
# Safe to repeat and after an interrupted run; when nothing has changed it does nothing. All holds what run needs, in the
# same versions, so that one is put on top of the other.
# PYTHON=python3.12 scripts/setup.sh takes that interpreter.
set -eu
cd "$(dirname "$0")/.."
set_name=${1:-all}
here=$(pwd -P)
PATH=$PATH:/usr/sbin:/sbin # ldconfig lives there, outside a user's path
venv_python=.venv/bin/python
stamps=.venv/ready # -run and -all: what this set was made from

# Debian package, and what shows that it is there: a command, a file, or a shared library.
gui_needs='
libegl1 libEGL.so.1
libgl1 libGL.so.1
libglib2.0-0 libgthread-2.0.so.0
libdbus-1-3 libdbus-1.so.3
libxkbcommon0 libxkbcommon.so.0
libxkbcommon-x11-0 libxkbcommon-x11.so.0
libxcb-cursor0 libxcb-cursor.so.0
libxcb-icccm4 libxcb-icccm.so.4
libxcb-keysyms1 libxcb-keysyms.so.1
libxcb-shape0 libxcb-shape.so.0
fontconfig fc-list
fonts-dejavu-core /usr/share/fonts/truetype/dejavu/DejaVuSans.ttf
'

# The same for cameras (GenICam, through Aravis), and for building PyGObject, which has no wheels.
camera_needs='
gir1.2-aravis-0.8 /usr/lib/*/girepository-1.0/Aravis-0.8.typelib
aravis-tools arv-fake-gv-camera-0.8
libgirepository1.0-dev /usr/lib/*/pkgconfig/gobject-introspection-1.0.pc
pkg-config pkg-config
gcc gcc
'

# And for the scenes that Mitsuba renders, whose kernels LLVM compiles.
renderer_needs='
libllvm19 libLLVM.so.19.1
'

# And for the test that clicks through the window on a screen.
screen_needs='
xvfb Xvfb
xdotool xdotool
'

fail() {
    echo "setup: $*" >&2
    exit 1
}

version_of() {
    "$1" -c 'import sys; print(".".join(map(str, sys.version_info[:3])))' 2>/dev/null
}

new_enough() {
    "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null
}

find_python() {
    # Each is run, not only looked up: a version manager's stand-in may be on the path without a Python behind it.
    for candidate in ${PYTHON:-} python3 python3.13 python3.12 python3.11 python3.14; do
        if new_enough "$candidate"; then
            echo "$candidate"
            return
        fi
    done
    fail "needs Python 3.11 or later; found ${PYTHON:-python3} $(version_of "${PYTHON:-python3}" || echo 'not at all')." \
        "Install one (Debian 12, Ubuntu 24.04 or later: apt-get install python3 python3-venv) and run this again."
}

# What a set ($1) in this .venv was made from. Its place counts too: its scripts and the editable install hold the path.
fingerprint() {
    case $1 in
    run) cat pyproject.toml constraints-run.txt scripts/setup.sh | cksum ;;
    all)
        cat pyproject.toml constraints*.txt scripts/setup.sh | cksum
        echo "missing for cameras:$(missing "$camera_needs")"
        ;;
    esac
    version_of "$venv_python"
    echo "$here"
}

runs_this() {
    [ "$(version_of "$venv_python")" = "$(version_of "$1")" ]
}

is_ready() {
    [ -f "$stamps-$set_name" ] && [ "$(fingerprint "$set_name")" = "$(cat "$stamps-$set_name")" ] &&
        runs_this "${PYTHON:-$venv_python}"
}

is_present() {
    case $1 in
    *.so.*) ldconfig -p | grep -qF "$1" ;;
    # shellcheck disable=SC2086 # a star stands for the processor's name
    /*) ls $1 >/dev/null 2>&1 ;;
    *) command -v "$1" >/dev/null ;;
    esac
}

# Packages of a list whose sign is not there.
missing() {
    echo "$1" | while read -r package sign; do
        if [ -n "$package" ] && ! is_present "$sign"; then printf ' %s' "$package"; fi
    done
}

missing_venv_package() {
    "$1" -c 'import ensurepip, venv' 2>/dev/null || case $1 in
    python3.*) echo " $1-venv" ;;
    *) echo " python3-venv" ;;
    esac
}

headers_package() {
    "$1" -c 'import os, sys, sysconfig
sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' || case $1 in
    python3.*) echo " $1-dev" ;;
    *) echo " python3-dev" ;;
    esac
}

missing_camera_packages() {
    echo "$(missing "$camera_needs")$(headers_package "$1")"
}

apt_install() {
    echo "setup: installing$1 with apt-get"
    # A list that is partly out of reach is often still good enough for what is missing; install says so if not.
    apt-get update -qq || true
    # shellcheck disable=SC2086 # the list is words on purpose
    DEBIAN_FRONTEND=noninteractive apt-get -qq -y -o Dpkg::Use-Pty=0 install --no-install-recommends $1
}

# A Python ($1) that cannot make a .venv ends it; what the window needs ($2) does not.
see_to_system_packages() {
    needed=$(missing_venv_package "$1")
    wanted=$2
    if [ -z "$needed$wanted" ]; then return; fi
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        apt_install "$needed$wanted" || [ -z "$needed" ] || fail "apt-get could not install$needed; see above."
        return
    fi
    line="sudo apt-get install$needed$wanted"
    if [ -n "$needed" ]; then fail "system packages are missing. Run this, then try again: $line"; fi
    echo "setup: the window and its tests need libraries that are missing. To have them: $line" >&2
}

# What an extra needs ($2) is said where it cannot be had, with what it is for ($1); nothing else waits for it.
see_to_packages_of_extra() {
    if [ -z "$2" ]; then return; fi
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null && apt_install "$2"; then return; fi
    echo "setup: $1 need packages that are missing. To have them: sudo apt-get install$2" >&2
}

# A .venv that runs this Python, with a pip of its own, at this place, can be brought up to date.
is_usable() {
    runs_this "$1" &&
        "$venv_python" -m pip --version >/dev/null 2>&1 &&
        grep -qF "$here/.venv/" .venv/bin/pip
}

# Bytecode comes afterwards: pip would compile every file, one after another, which takes as long as the rest.
pip_install() {
    "$venv_python" -m pip install -q --disable-pip-version-check --no-compile "$@"
}

# Python's way to Aravis. It is built here, once, within seconds, by tools that are pinned as well.
install_for_cameras() {
    if [ -n "$(missing_camera_packages "$venv_python")" ]; then return; fi
    pip_install --require-hashes -r constraints-genicam-build.txt &&
        PATH=$here/.venv/bin:$PATH pip_install --require-hashes --no-deps --no-build-isolation -r constraints-genicam.txt ||
        echo "setup: PyGObject could not be built, see above: no GenICam cameras, all else is ready." \
            "To try again: rm .venv/ready-all, then make setup." >&2
}

# What nobody here has a use for: the packages' own tests, and 160 MB of debug information in HDF5's filters.
trim() {
    find .venv/lib/python3*/site-packages -name tests -type d -prune -exec rm -rf {} +
    if ! command -v strip >/dev/null; then return; fi
    # Names of what nobody calls from outside: LLVM's alone take 19 MB.
    find .venv/lib/python3*/site-packages/llvmlite .venv/lib/python3*/site-packages/kiwisolver \
        .venv/lib/python3*/site-packages/fontTools -name '*.so' -exec strip --strip-unneeded {} + || true
    strip --strip-debug .venv/lib/python3*/site-packages/hdf5plugin/plugins/*.so ||
        echo "setup: HDF5's filters keep their debug information, see above; they work all the same." >&2
}

# Bytecode of what the commands import, also where the environment says that none is to be written: without it every
# process would compile anew.
compile_imported() {
    env -u PYTHONDONTWRITEBYTECODE "$venv_python" -c '
from contextlib import suppress
from importlib import import_module
from pathlib import Path

for package in ("analysis", "cli", "drivers", "instrument", "protocols"):
    for path in Path(package).rglob("*.py"):
        if path.name != "__init__.py":
            with suppress(ImportError):
                import_module(".".join(path.with_suffix("").parts))
'
}

# Some packages ship files that are no Python, on purpose.
compile_all() {
    "$venv_python" -m compileall -qq -j 0 .venv/lib || true
}

stamp() {
    fingerprint "$1" >"$stamps.new"
    mv "$stamps.new" "$stamps-$1"
}

install_run() {
    echo "setup: installing what the commands need into .venv (half a minute and 0.7 GB the first time)"
    pip_install --require-hashes -r constraints-run.txt
}

install_all() {
    echo "setup: installing everything into .venv (about a minute and 2 GB the first time)"
    pip_install --require-hashes -r constraints.txt
}

install() {
    rm -f "$stamps"*
    is_usable "$1" || "$1" -m venv --clear .venv
    "install_$set_name"
    # The build backend is pinned with the rest, so nothing arrives that has no hash.
    pip_install --no-build-isolation --no-deps -e .
    case $set_name in
    run)
        trim
        compile_imported
        ;;
    all)
        install_for_cameras
        compile_all
        stamp all
        ;;
    esac
    stamp run
}

case $set_name in
run | all) ;;
*) fail "there is no set '$set_name'; there are run (what the commands need) and all" ;;
esac
if is_ready; then exit 0; fi
python=$(find_python)
if [ "$set_name" = all ]; then
    see_to_system_packages "$python" "$(missing "$gui_needs")"
    see_to_packages_of_extra 'GenICam cameras and their tests' "$(missing_camera_packages "$python")"
    see_to_packages_of_extra 'scenes that Mitsuba renders' "$(missing "$renderer_needs")"
    see_to_packages_of_extra 'clicks on a screen, in one test,' "$(missing "$screen_needs")"
else
    see_to_system_packages "$python" ''
fi
install "$python"
echo "setup: ready ($(version_of "$venv_python"))"
