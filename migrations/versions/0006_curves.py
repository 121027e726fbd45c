"""Outputs of studies that are curves."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Say of every study which of its outputs are curves; there were none."""
    op.add_column("studies", sa.Column("curves", sa.JSON, nullable=False, server_default="{}"))


def downgrade() -> None:
    """Go back to 0005; results of curves stay, as texts that it cannot read."""
    op.drop_column("studies", "curves")
