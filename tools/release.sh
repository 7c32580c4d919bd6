#!/bin/bash
# `make release`: checks that a release is ready, builds and checks its files, and tags it. Pushes and uploads nothing.
# The argument is the Python that makes the environment of build and twine.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=build/release-tools

refuse() {
  echo "error: $1" >&2
  exit 2
}

version=$(sed -n 's/^__version__ = "\(.*\)"$/\1/p' src/urbantwin/__init__.py)
tag=v$version
[[ $version =~ ^[0-9]+\.[0-9]+\.[0-9]+$ ]] \
  || refuse "src/urbantwin/__init__.py: __version__ is '$version', expected X.Y.Z"
heading=$(grep -m 1 -E "^## \[$version\] - [0-9]{4}-[0-9]{2}-[0-9]{2}\$" CHANGELOG.md) \
  || refuse "CHANGELOG.md has no heading '## [$version] - YYYY-MM-DD'"
grep -qx "version: $version" CITATION.cff || refuse "CITATION.cff: version is not $version"
grep -qx "date-released: ${heading##* }" CITATION.cff \
  || refuse "CITATION.cff: date-released is not ${heading##* }, the date in CHANGELOG.md"
[[ -z $(git status --porcelain) ]] || refuse "there are changes that are not committed: git status"
! git rev-parse --quiet --verify "refs/tags/$tag" >/dev/null || refuse "the tag $tag exists: raise __version__"

if [[ ! -x $tools/bin/twine ]]; then
  "${1:-python3}" -m venv "$tools"
  "$tools/bin/python" -m pip install --quiet --disable-pip-version-check build==1.6.1 twine==7.0.0
fi
rm -rf build/release
"$tools/bin/python" -m build --outdir build/release .
"$tools/bin/python" -m twine check --strict build/release/*
for file in "urbantwin-$version.tar.gz" "urbantwin-$version-"*.whl; do
  # shellcheck disable=SC2086 # the second name is a pattern
  compgen -G "build/release/$file" >/dev/null || refuse "the build made no $file"
done
mkdir -p dist
mv build/release/* dist/
rmdir build/release
git tag --annotate --message "UrbanTwin $version" "$tag"

echo "made the tag $tag and, in dist/, the sdist and the wheel; nothing was pushed or uploaded. To publish:"
echo "  git push origin $tag"
echo "  $tools/bin/twine upload dist/urbantwin-$version.tar.gz dist/urbantwin-$version-*.whl"
