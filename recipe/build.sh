#!/usr/bin/env bash
# The build of recipe.yaml: $PYTHON is that of the host environment, CMAKE_ARGS (set by conda) names its libraries.
set -euo pipefail
export SKBUILD_CMAKE_DEFINE="OCISAC_EIGEN_FFT=ON"
"$PYTHON" -m pip install . -v --no-deps --no-build-isolation --no-index
