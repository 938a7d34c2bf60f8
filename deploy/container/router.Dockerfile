# A Zenoh router with a site's access rules, by the library that the server has: no other download is needed.
# Build from the repository: docker build -f deploy/container/router.Dockerfile -t mcrouter .
FROM python:3.12-slim-bookworm AS wheels
WORKDIR /source
COPY . .
RUN python -m pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.12-slim-bookworm
COPY --from=wheels /wheels /wheels
RUN python -m pip install --no-cache-dir "$(echo /wheels/mcserver-*.whl)[security]" \
    && rm -r /wheels \
    && useradd --create-home --uid 10001 mcrouter
USER mcrouter
EXPOSE 7447
STOPSIGNAL SIGTERM
ENTRYPOINT ["mcserver", "security", "router"]
CMD ["/etc/mcrouter"]
