"""Host classes, priorities, re-runs and tokens.

A row is handed out whole from here on: its first instance fixes the kind of machine, the others
wait for it. So rows that 0001 left begun in part are filled up with waiting instances.
"""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

#: SQLite counts up only what it calls INTEGER PRIMARY KEY.
_COUNTING = sa.BigInteger().with_variant(sa.Integer, "sqlite")
_PENDING = sa.text("state = 'pending'")


def upgrade() -> None:
    """Add what 0001 did not know, with values that change nothing for studies that run."""
    op.add_column("studies", sa.Column("priority", sa.Integer, nullable=False, server_default="0"))
    op.add_column("studies", sa.Column("tags", sa.JSON, nullable=False, server_default="[]"))
    op.add_column("studies", sa.Column("identity", sa.JSON))
    op.add_column(
        "studies", sa.Column("edition", sa.BigInteger, nullable=False, server_default="0")
    )
    op.add_column("instances", sa.Column("host_class", sa.String(16)))
    op.add_column("instances", sa.Column("avoid", sa.String(255)))
    op.add_column("leases", sa.Column("host_class", sa.String(16)))
    op.add_column("workers", sa.Column("host_class", sa.String(16)))
    op.add_column("workers", sa.Column("tags", sa.JSON, nullable=False, server_default="[]"))
    op.drop_index("instances_returned", "instances")
    op.create_index(
        "instances_returned",
        "instances",
        ["study_id", "host_class", "row", "position"],
        sqlite_where=_PENDING,
        postgresql_where=_PENDING,
    )
    op.create_table(
        "superseded",
        sa.Column("id", _COUNTING, primary_key=True),
        sa.Column("study_id", sa.String(32), sa.ForeignKey("studies.id"), nullable=False),
        sa.Column("row", sa.BigInteger, nullable=False),
        sa.Column("position", sa.Integer, nullable=False),
        sa.Column("outcome", sa.String(40), nullable=False),
        sa.Column("outputs", sa.JSON),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("worker_id", sa.String(128), sa.ForeignKey("workers.id"), nullable=False),
        sa.Column("received_at", sa.Double, nullable=False),
        sa.Column("superseded_at", sa.Double, nullable=False),
        sa.Column("why", sa.String(200), nullable=False),
    )
    op.create_index("ix_superseded_study_id", "superseded", ["study_id"])
    op.create_table(
        "tokens",
        sa.Column("id", sa.String(16), primary_key=True),
        sa.Column("name", sa.String(128), nullable=False),
        sa.Column("scopes", sa.JSON, nullable=False),
        sa.Column("digest", sa.String(64), nullable=False, unique=True),
        sa.Column("created_at", sa.Double, nullable=False),
        sa.Column("revoked_at", sa.Double),
    )
    _fill_begun_rows()


def downgrade() -> None:
    """Go back to 0001; what only 0002 knows (priorities, tokens, replaced results) is gone."""
    connection = op.get_bind()
    # 0001 hands out in order and knows no pause.
    connection.execute(sa.text("UPDATE studies SET state = 'running' WHERE state = 'paused'"))
    op.drop_table("tokens")
    op.drop_table("superseded")
    op.drop_index("instances_returned", "instances")
    op.create_index(
        "instances_returned",
        "instances",
        ["study_id", "row", "position"],
        sqlite_where=_PENDING,
        postgresql_where=_PENDING,
    )
    for name, columns in (
        ("workers", ("tags", "host_class")),
        ("leases", ("host_class",)),
        ("instances", ("avoid", "host_class")),
        ("studies", ("edition", "identity", "tags", "priority")),
    ):
        for column in columns:
            # SQLite drops plain columns itself; a copied table would lose its partial index.
            op.drop_column(name, column)


def _fill_begun_rows() -> None:
    """Add the waiting rest of every study's last row that was handed out in part."""
    connection = op.get_bind()
    studies = sa.table("studies", *map(sa.column, ("id", "rows", "instances", "handed_out")))
    instances = sa.table(
        "instances",
        sa.column("study_id"),
        sa.column("row"),
        sa.column("position"),
        sa.column("state"),
        sa.column("attempts", sa.JSON),
    )
    for study in connection.execute(sa.select(studies)).all():
        width = study.instances // study.rows
        row, begun = divmod(study.handed_out, width)
        if begun == 0:
            continue
        connection.execute(
            sa.insert(instances),
            [
                {
                    "study_id": study.id,
                    "row": row,
                    "position": position,
                    "state": "pending",
                    "attempts": {},
                }
                for position in range(begun, width)
            ],
        )
        connection.execute(
            sa.update(studies).where(studies.c.id == study.id).values(handed_out=(row + 1) * width)
        )
