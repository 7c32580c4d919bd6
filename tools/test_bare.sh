#!/bin/bash
# `make demo` and `make test` on bare Debian: a chroot with git, make and python3, and a clean clone.
#   tools/test_bare.sh [SUITE:TARGET,TARGET...]...   (default: bookworm:demo,test trixie:test,demo)
# Needs root and debootstrap. Logs and a summary are written to build/bare/, the chroots (15 GB each)
# to $BARE_FOLDER (/var/tmp/urbantwin-bare), where they are removed if all passed.
# What a network asks for is handed in, never built in:
#   BARE_MIRROR  the mirror to bootstrap from       BARE_ENV   variables to pass, by name
#   BARE_COPY    files to copy in                   BARE_BIND  folders to mount, e.g. a cache of pip's
# Ubuntu: BARE_MIRROR=http://archive.ubuntu.com/ubuntu BARE_COMPONENTS=main,universe and noble:demo
set -euo pipefail
cd "$(dirname "$0")/.."

folder=${BARE_FOLDER:-/var/tmp/urbantwin-bare}
out=$PWD/build/bare
((EUID == 0)) || { echo "error: chroots need root" >&2; exit 1; }
command -v debootstrap >/dev/null || { echo "error: type: apt-get install debootstrap" >&2; exit 1; }
mkdir -p "$out" "$folder"
: >"$out/summary.txt"
say() { echo "$*" | tee -a "$out/summary.txt"; }

# bootstrap SUITE ROOT: only what a user is asked to have, and a clone of the last commit.
bootstrap() {
  rm -rf --one-file-system "$2"
  debootstrap --variant=minbase --include=git,make,python3 \
    ${BARE_COMPONENTS:+--components="$BARE_COMPONENTS"} "$1" "$2" \
    ${BARE_MIRROR:+"$BARE_MIRROR"} >"$out/$1-debootstrap.log" 2>&1
  cp -L /etc/resolv.conf /etc/hosts "$2/etc/"
  for file in ${BARE_COPY:-}; do
    install -D "$file" "$2$file"
  done
  git clone --quiet --no-hardlinks . "$2/root/urbantwin"
}

# inside ROOT COMMAND: in mounts of its own, which end with it.
inside() {
  ROOT=$1 COMMAND=$2 SHARED=$(realpath -q ../shared || true) unshare --mount --pid --fork bash -ec '
    mount --make-rprivate /
    mount -t proc proc "$ROOT/proc"
    mount --rbind /dev "$ROOT/dev"
    mount -t tmpfs tmpfs "$ROOT/dev/shm"
    for place in ${BARE_BIND:-}; do mkdir -p "$ROOT$place"; mount --bind "$place" "$ROOT$place"; done
    if [[ -d $SHARED ]]; then
      mkdir -p "$ROOT/root/shared"
      mount --bind "$SHARED" "$ROOT/root/shared"
      mount -o remount,bind,ro "$ROOT/root/shared"
    fi
    kept=()
    for name in ${BARE_ENV:-}; do [[ -z ${!name:-} ]] || kept+=("$name=${!name}"); done
    exec chroot "$ROOT" /usr/bin/env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin "${kept[@]}" \
      sh -c "cd /root/urbantwin && $COMMAND"'
}

failed=0
for what in "${@:-bookworm:demo,test trixie:test,demo}"; do
  for pair in $what; do
    suite=${pair%%:*} root=$folder/${pair%%:*}
    bootstrap "$suite" "$root"
    say "$suite: $(inside "$root" 'python3 --version'), $(git log -1 --format=%h)"
    for target in $(tr , ' ' <<<"${pair#*:}"); do
      begin=$SECONDS log=$out/$suite-$target.log
      if inside "$root" "make $target" >"$log" 2>&1 </dev/null; then result=passed; else
        result="FAILED ($log)" failed=1
      fi
      say "$suite: make $target $result, $((SECONDS - begin)) s"
      say "$(grep -E '^(SKIPPED|FAILED|ERROR)|^=+ .* in [0-9]|^no Chromium|^installing' "$log" \
        | cut -c1-200 || true)"
    done
    ((failed)) || rm -rf --one-file-system "$root"
  done
done
exit $failed
