# The command line with compiled kernels, for any x86-64 processor with AVX2:
#   docker build -t swarmdata . && docker run --rm -v "$PWD:/data" -v swarmdata:/cache swarmdata list
# For GPUs: --build-arg TORCH_INDEX=https://download.pytorch.org/whl/cu128, and `docker run --gpus all`.
FROM python:3.11-slim AS wheel
COPY . /source
WORKDIR /source
ENV NUMBA_CPU_NAME=x86-64-v3 NUMBA_CPU_FEATURES= NUMBA_CACHE_DIR=/kernels
RUN pip install --no-cache-dir hatchling hatch-fancy-pypi-readme --editable . \
 && swarmdata warm \
 && python -m swarmdata.building.kernel_pack swarmdata/runtime/kernel_pack_files \
 && python -m hatchling build --target wheel --directory /dist

FROM python:3.11-slim
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu
COPY --from=wheel /dist /dist
RUN pip install --no-cache-dir torch --index-url "$TORCH_INDEX" \
 && pip install --no-cache-dir "$(echo /dist/*.whl)[torch,plots,parquet]" \
 && rm -r /dist && mkdir --mode 777 /cache /data
ENV SWARMDATA_CACHE=/cache
WORKDIR /data
ENTRYPOINT ["swarmdata"]
CMD ["--help"]
