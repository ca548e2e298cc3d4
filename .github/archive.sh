#!/bin/sh
# Makes FOLDER/posing-VERSION-TARGET.tar.gz of a program that is built: what `make install` installs, with the README, the
# changelog and the licenses. Unpacked over a prefix such as ~/.local, it is installed.
#
#   archive.sh TARGET BIN FOLDER
#   archive.sh x86_64-unknown-linux-musl target/x86_64-unknown-linux-musl/dist target/archive
set -eu
target=$1 bin=$2 folder=$3
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -n 1)
name=posing-$version-$target
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
rm -rf "${folder:?}/$name" "$folder/$name.tar.gz"
# `-o build`: the program is built already, perhaps for another target.
"${MAKE:-make}" -s -o build install BIN="$bin" PREFIX= DESTDIR="$folder/$name"
cp README.md CHANGELOG.md LICENSE LICENSE-APACHE LICENSE-MIT target/third-party.txt "$folder/$name"
# All files are root's, whoever builds: they may be unpacked into /usr/local.
owner='--uid 0 --gid 0'
if tar --version | grep -q GNU; then owner='--owner=0 --group=0 --numeric-owner'; fi
# shellcheck disable=SC2086
COPYFILE_DISABLE=1 tar $owner -czf "$folder/$name.tar.gz" -C "$folder" "$name"
rm -rf "${folder:?}/$name"
echo "$folder/$name.tar.gz"
