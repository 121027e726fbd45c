"""How precise a study is to become, kept with it."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add a table of goals."""
    op.create_table(
        "goals",
        sa.Column("study_id", sa.String(32), sa.ForeignKey("studies.id"), primary_key=True),
        sa.Column("output", sa.String(128), nullable=False),
        sa.Column("target", sa.Double),
        sa.Column("up_to", sa.BigInteger, nullable=False),
        sa.Column("judged", sa.BigInteger),
        sa.Column("steps", sa.JSON, nullable=False),
    )


def downgrade() -> None:
    """Go back to 0003; studies keep the rows they have and are extended no more."""
    op.drop_table("goals")
