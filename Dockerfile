# strandcast with pinned packages: `docker build --tag strandcast:0.2.0 .`, then in a project's folder
# `docker run --rm --user "$(id -u):$(id -g)" --volume "$PWD:/project" strandcast:0.2.0 run demo`.
# The digest is that of the index of all platforms.
FROM python:3.11.14-slim-bookworm@sha256:65a93d69fa75478d554f4ad27c85c1e69fa184956261b4301ebaf6dbb0a3543d AS build
WORKDIR /src
COPY requirements/build.lock requirements/runtime.lock requirements/
ENV PATH=/opt/strandcast/bin:$PATH
RUN python -m venv /opt/strandcast && \
    pip install --no-cache-dir --require-hashes --only-binary :all: -r requirements/build.lock && \
    uv pip install --no-cache --compile-bytecode --require-hashes --no-build-isolation \
      --python /opt/strandcast/bin/python -r requirements/runtime.lock
COPY . .
# Compiled kernels go into the wheel, for all levels of processors that this one has: minutes.
RUN PYTHONPATH=/src/src python -m strandcast_studies.kernel_seeds build/kernels
RUN pip wheel --no-deps --no-build-isolation --wheel-dir dist . && \
    uv pip install --no-cache --compile-bytecode --no-deps --python /opt/strandcast/bin/python dist/*.whl && \
    pip uninstall --yes uv wheel setuptools pip

FROM python:3.11.14-slim-bookworm@sha256:65a93d69fa75478d554f4ad27c85c1e69fa184956261b4301ebaf6dbb0a3543d
COPY --from=build /opt/strandcast /opt/strandcast
# Any user may run it: what is compiled and cached is kept in a folder that all can write.
ENV PATH=/opt/strandcast/bin:$PATH HOME=/tmp
WORKDIR /project
ENTRYPOINT ["strandcast"]
