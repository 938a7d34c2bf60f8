# A motion server. Build from the repository: docker build -f deploy/container/server.Dockerfile -t mcserver .
FROM python:3.12-slim-bookworm AS wheels
WORKDIR /source
COPY . .
RUN python -m pip wheel --no-cache-dir --no-deps --wheel-dir /wheels . clients/python

FROM python:3.12-slim-bookworm
COPY --from=wheels /wheels /wheels
RUN python -m pip install --no-cache-dir /wheels/mcserver-*.whl \
    && python -m pip install --no-cache-dir "$(echo /wheels/mcclient-*.whl)[cli]" \
    && rm -r /wheels \
    && useradd --create-home --uid 10001 mcserver \
    && install -d -o mcserver /var/lib/mcserver /var/cache/mcserver
USER mcserver
ENV NUMBA_CACHE_DIR=/var/cache/mcserver
VOLUME ["/var/lib/mcserver", "/var/cache/mcserver"]
# SIGTERM brings every axis to a controlled stop
STOPSIGNAL SIGTERM
ENTRYPOINT ["mcserver"]
CMD ["run", "--machine", "/etc/mcserver/machine.toml", "--zenoh-config", "/etc/mcserver/zenoh.json5", \
     "--journal", "/var/lib/mcserver/journal.sqlite"]
