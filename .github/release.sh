#!/bin/sh
# Makes what a release ships for TARGET: target/wheels/*.whl, and in target/archive the wheel, on Linux and macOS an
# archive, on Debian a .deb, and SHA256SUMS.
#
#   release.sh [TARGET]
set -eu
target=${1:-$(rustc -vV | sed -n 's/^host: //p' | sed 's/-linux-gnu$/-linux-musl/')}
wheel=$(sh .github/wheel.sh "$target")
rm -rf target/archive
mkdir -p target/archive
cp "$wheel" target/archive
case $target in
  *-windows-*) ;;
  *) sh .github/archive.sh "$target" "target/$target/dist" target/archive ;;
esac
case $target in
  *-linux-musl) if command -v dpkg-deb > /dev/null; then sh .github/deb.sh "target/$target/dist" target/archive; fi ;;
esac
cd target/archive
rm -f SHA256SUMS
sums=$(if command -v sha256sum > /dev/null; then sha256sum -- *; else shasum -a 256 -- *; fi)
echo "$sums" > SHA256SUMS
