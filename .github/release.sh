#!/bin/sh
# Makes what a release ships for TARGET: target/wheels/*.whl, and in target/archive an archive, a .deb and SHA256SUMS.
#
#   release.sh [TARGET]
set -eu
target=${1:-$(rustc -vV | sed -n 's/^host: //p' | sed 's/-linux-gnu$/-linux-musl/')}
wheel=$(sh .github/wheel.sh "$target")
archive=$(sh .github/archive.sh "$target" "target/$target/dist" target/archive)
case $target in
  *-linux-musl) if command -v dpkg-deb > /dev/null; then sh .github/deb.sh "target/$target/dist" target/archive; fi ;;
esac
cp "$wheel" target/archive
echo "$archive"
cd target/archive
rm -f SHA256SUMS
sha256sum -- * > SHA256SUMS
