"""Workers tell which models they refuse, and why."""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Say of no worker that it refuses a model: none told so."""
    op.add_column("workers", sa.Column("refused", sa.JSON, nullable=False, server_default="{}"))


def downgrade() -> None:
    """Go back to 0010."""
    op.drop_column("workers", "refused")
