"""Alembic migrations: the only way the coordinator's database comes to be or changes."""
