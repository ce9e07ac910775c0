"""Run by Alembic around the migrations. coastwatch/store/schema/migrate.py hands over a connection in whose transaction they run."""

from alembic import context

from coastwatch.store.schema.tables import METADATA, REVISION_TABLE

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=METADATA,
    version_table=REVISION_TABLE,
    transactional_ddl=True,
)
with context.begin_transaction():
    context.run_migrations()
