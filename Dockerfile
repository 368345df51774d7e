# Not built yet, for want of a machine with a Docker daemon.
# docker build -t sgslam . && docker run --rm -v "$PWD":/work sgslam run --demo
FROM python:3.11-slim AS wheel
WORKDIR /source
COPY . .
RUN pip wheel --no-cache-dir --no-deps -w /wheel .

FROM python:3.11-slim
RUN --mount=type=bind,from=wheel,source=/wheel,target=/wheel pip install --no-cache-dir /wheel/*.whl
ENV SGSLAM_CACHE_DIR=/tmp/sgslam MPLCONFIGDIR=/tmp/matplotlib NUMBA_CACHE_DIR=/var/cache/sgslam
# the demo: the image works, and what is compiled at a first run is in it, for any user
RUN sgslam run --demo --out /tmp/demo && rm -r /tmp/* && chmod -R a+rwX /var/cache/sgslam
# results belong to whoever owns the mounted folder: docker run --user "$(id -u):$(id -g)"
WORKDIR /work
ENTRYPOINT ["sgslam"]
CMD ["--help"]
