"""Factors of studies that move together."""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Say of every study which of its factors move together; there were none."""
    op.add_column("studies", sa.Column("groups", sa.JSON, nullable=False, server_default="[]"))


def downgrade() -> None:
    """Go back to 0007; studies of groups are none that it can go on with."""
    op.drop_column("studies", "groups")
