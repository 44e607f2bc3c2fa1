#!/bin/sh
# No tracked file may name a package registry's host or a path of somebody's machine, nor be an installed package.
set -eu
cd "$(dirname "$0")/.."
if ! git rev-parse --is-inside-work-tree >/dev/null 2>&1; then
    echo "check_tracked_files: no git checkout, nothing to check"
    exit 0
fi

hosts='pypi[a-z-]*\.[a-z]|python[h]osted|(registry|mirror|proxy|index)\.[a-z-]+\.[a-z]|(index-url|trusted-host|find-links)[= ]+[a-z/]'
paths='(^|[^A-Za-z0-9_.-])/(home|root|Users|work)/[A-Za-z]'
found=0
for pattern in "$hosts" "$paths"; do
    # Exit code 1 says that nothing was found; anything above is a failure of git itself.
    status=0
    git grep -nIE -e "$pattern" -- . ':!*.csv' || status=$?
    case $status in
    0) found=1 ;;
    1) ;;
    *) exit "$status" ;;
    esac
done
if git ls-files | grep -E '\.(whl|egg|so|pyc)$'; then found=1; fi
if [ "$found" = 1 ]; then
    echo "check_tracked_files: the lines above name a registry's host or a machine's path, or are packages; take them out" >&2
    exit 1
fi
