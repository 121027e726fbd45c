"""What SQL needs: connections and transactions, tables, prepared statements, files in parts."""
