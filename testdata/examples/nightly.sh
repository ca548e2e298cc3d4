#!/bin/sh
# Cleans up every take of a folder once: nightly.sh TAKES CLEAN
#
# TAKES/NAME.csv becomes CLEAN/NAME.csv, gaps filled and each point's status told. What is there and newer than its take is
# left alone, so a night that was cut short goes on the next one. Failures are logged in CLEAN/failures.log and make the
# exit code 3; the other takes are done all the same. A table appears complete or not at all.
set -u
takes=${1:?nightly.sh TAKES CLEAN} clean=${2:?nightly.sh TAKES CLEAN} posing=${POSING:-posing}
failed=0
mkdir -p "$clean" || exit 1
for take in "$takes"/*.csv; do
  [ -e "$take" ] || continue
  done=$clean/$(basename "$take")
  [ -e "$done" ] && [ -z "$(find "$take" -newer "$done")" ] && continue
  if ! said=$("$posing" complete --status -o "$done" "$take" 2>&1); then
    printf '%s %s\n' "$(date -u +%Y-%m-%dT%H:%M:%SZ)" "$said" >> "$clean/failures.log"
    failed=1
  fi
done
[ "$failed" = 0 ] || exit 3
