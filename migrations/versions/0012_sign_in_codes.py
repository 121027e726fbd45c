"""Codes that sign a browser in, for whichever coordinator is asked."""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the table: those that were in a coordinator's memory ended with it."""
    op.create_table(
        "sign_in_codes",
        sa.Column("digest", sa.String(64), primary_key=True),
        sa.Column("who", sa.String(16), nullable=False),
        sa.Column("good_until", sa.Double, nullable=False),
    )


def downgrade() -> None:
    """Go back to 0011."""
    op.drop_table("sign_in_codes")
