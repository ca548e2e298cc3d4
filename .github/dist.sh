#!/bin/sh
# Builds the program that wheels and archives ship: optimized for size and speed, without OpenBLAS, on Linux static; and
# writes the licenses of the crates in it into target/third-party.txt.
#
#   dist.sh TARGET
set -eu
target=$1
if ! rustup target list --installed | grep -qx "$target"; then rustup target add "$target"; fi
case $target in
  *-linux-musl)
    if ! command -v musl-gcc > /dev/null; then
      if [ "$(id -u)" != 0 ] || ! command -v apt-get > /dev/null; then
        echo 'posing: please install musl-gcc (Debian, Ubuntu: musl-tools)' >&2
        exit 1
      fi
      apt-get update -qq
      DEBIAN_FRONTEND=noninteractive apt-get install -y musl-tools > /dev/null
    fi ;;
esac
export POSING_COMMIT="${POSING_COMMIT:-}"
cargo build --locked --profile dist --target "$target" --no-default-features --features cli
python3 .github/third-party.py "$target" > target/third-party.txt
