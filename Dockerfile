FROM python:3.12-slim
WORKDIR /app
COPY pyproject.toml README.md LICENSE ./
COPY rehyb rehyb
COPY intake intake
COPY models models
COPY sim sim
COPY analysis analysis
COPY server server
COPY worker worker
COPY migrations migrations
RUN pip install --no-cache-dir '.[server,postgresql,figures]' \
    && install -d -o nobody /var/lib/rehyb
# Where results wait until they are posted, and a SQLite database: it must outlast the container.
ENV HOME=/var/lib/rehyb XDG_STATE_HOME=/var/lib/rehyb
VOLUME /var/lib/rehyb
WORKDIR /var/lib/rehyb
USER nobody
ENTRYPOINT ["rehyb"]
