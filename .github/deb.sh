#!/bin/sh
# Makes FOLDER/posing_VERSION_ARCHITECTURE.deb of a static program that is built: what `make install` installs.
#
#   deb.sh BIN FOLDER
set -eu
bin=$1 folder=$2
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -n 1)
description=$(sed -n 's/^description = "\(.*\)"$/\1/p' Cargo.toml | head -n 1)
architecture=$(dpkg --print-architecture)
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
chmod 755 "$root"
"${MAKE:-make}" -s -o build install BIN="$bin" PREFIX=/usr DESTDIR="$root"
gzip -9n "$root"/usr/share/man/man*/*
cat LICENSE LICENSE-MIT LICENSE-APACHE > "$root/usr/share/doc/posing/copyright"
cp target/third-party.txt "$root/usr/share/doc/posing/THIRD-PARTY.txt"
mkdir "$root/DEBIAN"
cat > "$root/DEBIAN/control" <<END
Package: posing
Version: $version
Architecture: $architecture
Maintainer: the posing developers <posing@localhost>
Installed-Size: $(du -sk "$root/usr" | cut -f 1)
Section: science
Priority: optional
Description: $description
 Small commands that read and write CSV, BVH, C3D and other files of motion.
END
mkdir -p "$folder"
dpkg-deb --root-owner-group --build "$root" "$folder/posing_${version}_$architecture.deb" > /dev/null
echo "$folder/posing_${version}_$architecture.deb"
