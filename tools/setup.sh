#!/bin/sh
# What `make` needs of the machine, before anything long begins:
#   setup.sh python        print the Python to use, 3.11 to 3.13 ($PYTHON where that is set)
#   setup.sh demo|test     check the system's libraries. On Debian and Ubuntu, what is missing is
#                          installed if that needs no password; else one line says what to type.
#   setup.sh browser       install Chromium if that needs no password: a minute, beside other things
# Exit code 1 if something is missing that cannot be installed here.
set -eu

# Libraries that wheels link to and do not carry, and the Debian package of each.
of_sumo='libatomic.so.1=libatomic1 libexpat.so.1=libexpat1 libGL.so.1=libgl1
  libXext.so.6=libxext6 libXrender.so.1=libxrender1'
of_open3d='libusb-1.0.so.0=libusb-1.0-0 libEGL.so.1=libegl1'
install='apt-get install --no-install-recommends'

fail() { echo "error: $*" >&2; exit 1; }
no_browser() { echo "no Chromium here: the tests that drive a browser will skip$*" >&2; }

# By version, not by name: `python3` may be older or newer than what the lock files hold.
find_python() {
  for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11}; do
    if path=$(command -v "$candidate") && "$path" -c \
      'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; then
      echo "$path"
      return
    fi
  done
  named=${PYTHON:-python3}
  version=$("$named" --version 2>/dev/null) || version='not here'
  fail "UrbanTwin needs Python 3.11 to 3.13, and $named is $version;" \
    "try make PYTHON=/path/to/python3.13"
}

# The Debian packages that are missing of LIBRARY=PACKAGE...: what the loader does not find.
missing_packages() {
  "$python" - "$@" <<'END'
import ctypes
import os
import sys

missing = []
for pair in sys.argv[1:] if sys.platform == "linux" else []:
    library, package = pair.split("=")
    try:
        ctypes.CDLL(library)
    except OSError:
        missing.append(package)
try:
    import ensurepip  # Debian's Python has it in a package of its own
    import venv
except ImportError:
    debian = os.path.realpath(sys.executable).startswith("/usr/bin/")
    missing.append(f"python{sys.version_info[0]}.{sys.version_info[1]}-venv" if debian else "python3-venv")
print(*missing)
END
}

has_browser() {
  for name in chromium chromium-browser google-chrome; do
    if command -v "$name" >/dev/null && "$name" --version >/dev/null 2>&1; then return 0; fi
  done
  return 1
}

# Ubuntu's package of Chromium fetches a snap, which no container runs.
apt_has_chromium() {
  apt-cache policy chromium 2>/dev/null | grep -q 'Candidate: [^(]' \
    && ! apt-cache show chromium 2>/dev/null | grep -qi snap
}

prepare_machine() {
  python=$(find_python)
  # shellcheck disable=SC2086  # lists of words
  if [ "$1" = demo ]; then
    packages=$(missing_packages $of_sumo) browser=unneeded
  else
    packages=$(missing_packages $of_sumo $of_open3d)
    if has_browser; then browser=here; else browser=missing; fi
  fi
  if [ -z "$packages" ] && [ "$browser" != missing ]; then return; fi

  if ! command -v apt-get >/dev/null; then
    [ "$browser" != missing ] || no_browser
    [ -z "$packages" ] \
      || echo "warning: install what these Debian packages hold: $packages" >&2
    return
  fi

  if ! may_install; then
    also=
    if [ "$browser" = missing ] && apt_has_chromium; then also=' chromium'; fi
    if [ -z "$packages" ]; then no_browser "${also:+ (sudo $install$also)}"; return; fi
    fail "Debian packages are missing; type: sudo $install $packages$also"
  fi
  if [ -n "$packages" ]; then install_packages "$packages"; fi
}

# Whether Debian packages can be installed without a password; sets $as_root.
may_install() {
  if [ "$(id -u)" = 0 ]; then as_root=; else as_root='sudo -n'; fi
  $as_root true 2>/dev/null
}

# The lists of packages, once: a bare machine has none.
fresh=
refresh_lists() { if [ -z "$fresh" ]; then $as_root apt-get update -qq && fresh=yes; fi; }

install_packages() {
  log=$(mktemp)
  trap 'rm -f "$log"' EXIT
  echo "installing Debian packages: $1"
  # shellcheck disable=SC2086  # lists of words
  { refresh_lists \
    && $as_root env DEBIAN_FRONTEND=noninteractive $install -y -qq $1; } >"$log" 2>&1 </dev/null || {
    cat "$log" >&2
    fail "this failed: $install $1"
  }
}

install_browser() {
  if has_browser || ! command -v apt-get >/dev/null || ! may_install; then return; fi
  refresh_lists >/dev/null 2>&1 </dev/null || true
  if ! apt_has_chromium || ! (install_packages chromium); then no_browser; fi
}

case ${1:-} in
  python) find_python ;;
  demo | test) prepare_machine "$1" ;;
  browser) install_browser ;;
  *) fail "usage: setup.sh python|demo|test|browser" ;;
esac
