#!/bin/sh
# Installs the system packages that building wants, where they are missing: OpenBLAS and pkg-config (Debian, Ubuntu).
# As root at once; else by sudo, after asking, when a terminal is there; else one line says what to install.
set -eu
packages=''
command -v cc >/dev/null 2>&1 || packages="$packages build-essential"
command -v pkg-config >/dev/null 2>&1 || packages="$packages pkg-config"
if ! pkg-config --exists openblas 2>/dev/null && ! ls /usr/lib/*/libopenblas.so /usr/lib/libopenblas.so \
    /usr/local/lib/libopenblas.so /opt/homebrew/opt/openblas/lib/libopenblas.dylib >/dev/null 2>&1; then
  packages="$packages libopenblas-dev"
fi
if [ -z "$packages" ]; then
  exit 0
fi
if ! command -v cargo >/dev/null 2>&1; then
  echo 'posing: Rust is missing: install it from https://rustup.rs' >&2
  exit 1
fi
install="apt-get install -y$packages"
if ! command -v apt-get >/dev/null 2>&1; then
  echo "posing: please install:$packages (on macOS: brew install openblas pkg-config)" >&2
  exit 1
fi
if [ "$(id -u)" = 0 ]; then
  echo "posing: installing$packages" >&2
  apt-get update -qq
  DEBIAN_FRONTEND=noninteractive $install >/dev/null
elif [ -t 0 ] && command -v sudo >/dev/null 2>&1; then
  printf 'posing: run "sudo %s"? [y/N] ' "$install" >&2
  read -r answer
  case "$answer" in
    y* | Y*) sudo apt-get update -qq && sudo $install ;;
    *) echo "posing: please run: sudo $install" >&2; exit 1 ;;
  esac
else
  echo "posing: please run: sudo $install" >&2
  exit 1
fi
