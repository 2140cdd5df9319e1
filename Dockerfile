# One image for every process of a team; docker-compose.yml says which command a container runs.
# Any base with glibc, Python 3.11 or newer and its venv module will do (Zenoh has no wheels for musl):
#   docker build --build-arg BASE=... .
# Packages come from wherever pip is configured to look (the arguments below), or, where `make wheels` has filled wheels/,
# from there alone, without a network.
ARG BASE=python:3.13-slim

FROM ${BASE} AS build
LABEL cop-blackboard.stage=build
ARG PIP_INDEX_URL
ARG PIP_EXTRA_INDEX_URL
ARG PIP_TRUSTED_HOST
WORKDIR /src
ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
RUN python3 -m venv /opt/venv
COPY LICENSE wheels* wheels/
RUN if ls wheels/*.whl; then printf '[install]\nno-index = 1\nfind-links = /src/wheels\n' > /opt/venv/pip.conf; fi
# Without its packages the project is an empty wheel with all its dependencies: a layer that outlives a change of the code.
COPY pyproject.toml README.md LICENSE ./
RUN /opt/venv/bin/pip install --no-cache-dir --no-compile '.[web]'
COPY blackboard blackboard
COPY robot_agent robot_agent
COPY sim_world sim_world
RUN /opt/venv/bin/pip install --no-cache-dir --no-compile --no-deps --force-reinstall . \
 && /opt/venv/bin/pip uninstall --yes pip setuptools \
 && rm -f /opt/venv/pip.conf \
 && python3 -m compileall -q --invalidation-mode unchecked-hash /opt/venv/lib

FROM ${BASE}
COPY --from=build /opt/venv /opt/venv
# As the launcher sets it (blackboard/run/supervisor.py): one thread for NumPy, and two heaps, so that memory stays flat.
ENV PATH=/opt/venv/bin:$PATH PYTHONUNBUFFERED=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MALLOC_ARENA_MAX=2
USER nobody
WORKDIR /tmp
EXPOSE 7447
CMD ["blackboard", "--help"]
