FROM python:3.12-slim
WORKDIR /app
COPY pyproject.toml README.md LICENSE ./
COPY rehyb rehyb
COPY sim sim
COPY analysis analysis
COPY server server
COPY worker worker
COPY migrations migrations
RUN pip install --no-cache-dir '.[server,postgresql,figures]'
USER nobody
ENTRYPOINT ["rehyb"]
