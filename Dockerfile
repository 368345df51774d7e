# docker build -t sgslam . && docker run --rm -v "$PWD":/work sgslam run --demo
FROM python:3.11-slim AS wheel
WORKDIR /source
COPY . .
RUN pip wheel --no-cache-dir --no-deps -w /wheel .

FROM python:3.11-slim
# torch's CPU build first: the default index would bring gigabytes of CUDA
RUN --mount=type=bind,from=wheel,source=/wheel,target=/wheel \
    pip install --no-cache-dir --index-url https://download.pytorch.org/whl/cpu "torch>=2.5,<2.14" \
    && pip install --no-cache-dir /wheel/*.whl
# results belong to whoever owns the mounted folder: docker run --user "$(id -u):$(id -g)"
ENV SGSLAM_CACHE_DIR=/tmp/sgslam MPLCONFIGDIR=/tmp/matplotlib
WORKDIR /work
ENTRYPOINT ["sgslam"]
CMD ["--help"]
