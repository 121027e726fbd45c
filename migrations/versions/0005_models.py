"""Models that are not rehyb's own, and who can evaluate them."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add models with their zip files, and what workers say they can evaluate."""
    op.create_table(
        "models",
        sa.Column("version", sa.String(64), primary_key=True),
        sa.Column("name", sa.String(64), nullable=False),
        sa.Column("description", sa.JSON, nullable=False),
        sa.Column("own", sa.Boolean, nullable=False),
        sa.Column("announced_by", sa.String(128), nullable=False),
        sa.Column("announced_at", sa.Double, nullable=False),
        sa.Column("size", sa.BigInteger, nullable=False),
    )
    op.create_index("ix_models_name", "models", ["name"])
    op.create_table(
        "model_parts",
        sa.Column("version", sa.String(64), sa.ForeignKey("models.version"), primary_key=True),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("content", sa.LargeBinary, nullable=False),
    )
    op.add_column("workers", sa.Column("models", sa.JSON, nullable=False, server_default="[]"))


def downgrade() -> None:
    """Go back to 0004; models and their files are gone."""
    op.drop_column("workers", "models")
    op.drop_table("model_parts")
    op.drop_table("models")
