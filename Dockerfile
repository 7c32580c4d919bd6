# syntax=docker/dockerfile:1
# UrbanTwin with what Ray and object storage need:
#   docker build -t urbantwin .
#   docker run --rm -v "$PWD:/work" urbantwin demo -o urbantwin-demo

# The page of `urbantwin view`.
FROM node:22-slim AS page
WORKDIR /build/web
COPY web/package.json web/package-lock.json ./
RUN npm ci --ignore-scripts --no-audit --no-fund --silent
COPY web/ ./
RUN npm run --silent build

# The wheel, and an environment of the locked versions with it.
FROM python:3.11-slim AS environment
WORKDIR /build
ENV UV_LINK_MODE=copy UV_NO_CACHE=1
RUN pip install --no-cache-dir --disable-pip-version-check uv==0.13.9 \
  && python -m venv /opt/urbantwin
COPY requirements.lock ./
RUN uv pip install --python /opt/urbantwin/bin/python -r requirements.lock
COPY LICENSE README.md hatch_build.py pyproject.toml ./
COPY src/ src/
COPY examples/two-avenues/ examples/two-avenues/
COPY --from=page /build/src/urbantwin/web/page/ src/urbantwin/web/page/
RUN uv build --wheel --out-dir dist \
  && uv pip install --python /opt/urbantwin/bin/python dist/*.whl \
  && uv pip install --python /opt/urbantwin/bin/python 'ray>=2.40' s3fs gcsfs

# What runs: no compiler, no pip, no root.
FROM python:3.11-slim
# What the wheels of SUMO link to and do not carry.
# hadolint ignore=DL3008
RUN apt-get update \
  && apt-get install --yes --no-install-recommends \
    libatomic1 libexpat1 libgl1 libxext6 libxrender1 \
  && rm -rf /var/lib/apt/lists/* \
  && useradd --create-home --uid 1000 urbantwin \
  && install --directory --owner=urbantwin --group=urbantwin /work
COPY --from=environment /opt/urbantwin /opt/urbantwin
ENV PATH=/opt/urbantwin/bin:$PATH PYTHONUNBUFFERED=1 RAY_USAGE_STATS_ENABLED=0
USER 1000
WORKDIR /work
ENTRYPOINT ["urbantwin"]
CMD ["--help"]
