"""Commands executed at scale: prompts, executions on many cores, Parquet files, window labels."""
