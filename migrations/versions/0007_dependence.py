"""Studies of factors that depend on each other."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Let a study say how its factors depend on each other; the others say nothing of it."""
    op.add_column("studies", sa.Column("dependence", sa.JSON))


def downgrade() -> None:
    """Go back to 0006; studies of dependent factors are as if theirs were independent."""
    op.drop_column("studies", "dependence")
