"""An index of the results that failed."""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Let the failures of a study be found by cause among a million results."""
    op.create_index(
        "results_failed",
        "results",
        ["study_id", "outcome", "seq"],
        sqlite_where=sa.text("outcome <> 'ok'"),
        postgresql_where=sa.text("outcome <> 'ok'"),
    )


def downgrade() -> None:
    """Go back to 0008."""
    op.drop_index("results_failed", "results")
