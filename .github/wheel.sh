#!/bin/sh
# Makes target/wheels/posing-VERSION-py3-none-PLATFORM.whl: the program, a static one on Linux, the Python package, manual
# pages, completions, examples and licenses.
#
#   wheel.sh [TARGET]
#   wheel.sh x86_64-unknown-linux-musl
set -eu
for tool in rustc rustup python3; do
  command -v "$tool" > /dev/null || { echo "posing: please install $tool (Rust: https://rustup.rs)" >&2; exit 1; }
done
target=${1:-$(rustc -vV | sed -n 's/^host: //p' | sed 's/-linux-gnu$/-linux-musl/')}
tools=target/wheel/tools
bin=bin
case $target in *-windows-*) bin=Scripts ;; esac
if [ ! -x "$tools/$bin/maturin" ]; then
  python3 -m venv "$tools"
  "$tools/$bin/python" -m pip install -q --disable-pip-version-check 'maturin>=1.9,<2'
fi
sh .github/dist.sh "$target"
stage=target/wheel/data
rm -rf "$stage" target/wheels
mkdir -p "$stage"
case $target in
  *-windows-*) mkdir -p "$stage/data/share/doc/posing" ;;
  *)
    "${MAKE:-make}" -s -o build install BIN="target/$target/dist" PREFIX= DESTDIR="$stage/data" > /dev/null
    # The program is installed by the wheel itself; links do not survive in one.
    rm -rf "$stage/data/bin"
    # Nor are the names that those are for.
    for folder in bash-completion zsh fish; do
      find "$stage/data/share/$folder" -type f ! -name posing ! -name _posing ! -name posing.fish -delete
    done ;;
esac
cp target/third-party.txt "$stage/data/share/doc/posing/THIRD-PARTY.txt"
platform=
case $target in
  # A static program runs on every Linux, whatever its C library.
  *-linux-musl) platform='--compatibility manylinux2014 musllinux_1_1' ;;
esac
# shellcheck disable=SC2086
"$tools/$bin/maturin" build --locked --target "$target" $platform -o target/wheels -q
echo target/wheels/*.whl
