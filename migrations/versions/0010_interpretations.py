"""Sessions are interpreted, too: jobs have a kind, and workers may have a bank."""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Say of every job that it closes a loop: there was no other kind."""
    kind = sa.Column("kind", sa.String(16), nullable=False, server_default="close-loop")
    op.add_column("close_loops", kind)
    op.add_column("close_loops", sa.Column("options", sa.JSON))
    op.add_column("loop_workers", sa.Column("bank", sa.String(32)))


def downgrade() -> None:
    """Go back to 0009, which knows no interpretation."""
    op.execute(
        "DELETE FROM close_loop_parts WHERE close_loop_id IN"
        " (SELECT id FROM close_loops WHERE kind <> 'close-loop')"
    )
    op.execute("DELETE FROM close_loops WHERE kind <> 'close-loop'")
    op.drop_column("close_loops", "kind")
    op.drop_column("close_loops", "options")
    op.drop_column("loop_workers", "bank")
