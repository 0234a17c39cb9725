#!/bin/sh
# Installs the Debian packages named as arguments that are not there yet; elsewhere says what to install.
set -eu

# Installed by other means? Then the headers and pkg-config files say so.
if command -v dpkg-query >/dev/null 2>&1; then
  missing=
  for package in "$@"; do
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing="$missing $package"
  done
  [ -n "$missing" ] || exit 0
  sudo=
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || { echo "As root: apt-get install$missing" >&2; exit 1; }
    sudo=sudo
  fi
  echo "Installing$missing" >&2
  # Debian's mirrors and locks have their moments: three tries.
  for try in 1 2 3; do
    if $sudo apt-get update -q >&2 &&
       $sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $missing >&2; then
      exit 0
    fi
    sleep $((5 * try))
  done
  echo "apt-get could not install$missing" >&2
  exit 1
fi

if pkg-config --exists OpenImageIO 2>/dev/null && { ls /usr/*include/embree[34] /usr/local/include/embree[34] \
   /opt/homebrew/include/embree[34]; } >/dev/null 2>&1; then
  exit 0
fi
cat >&2 <<'END'
relievo needs, beside Rust: Embree 4 (or 3.13) with headers, OpenImageIO with headers, libclang with headers,
a C++17 compiler and pkg-config. Debian and Ubuntu name them
  libembree-dev libopenimageio-dev openimageio-tools libclang-dev g++ pkg-config
(openimageio-tools for tests only).
Install them with your system's package manager and try again.
END
exit 1
