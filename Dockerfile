# uv build && docker build -t warp-trunk .
# docker run --rm -v "$PWD:/work" warp-trunk simulate patient
FROM python:3.13-slim
COPY dist/*.whl /wheels/
RUN pip install --no-cache-dir /wheels/*.whl
RUN useradd --create-home --uid 1000 trunk
USER trunk
WORKDIR /work
VOLUME /work
ENTRYPOINT ["warp-trunk"]
CMD ["doctor"]
