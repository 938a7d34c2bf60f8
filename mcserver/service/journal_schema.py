"""Tables of the service journal."""

SCHEMA_VERSION = 1

CREATE: tuple[str, ...] = (
    "CREATE TABLE IF NOT EXISTS starts(instance TEXT PRIMARY KEY, started_at REAL NOT NULL, stopped_at REAL)",
    "CREATE TABLE IF NOT EXISTS programs("
    " id INTEGER PRIMARY KEY, program TEXT UNIQUE NOT NULL, instance TEXT NOT NULL, client TEXT NOT NULL,"
    " name TEXT NOT NULL, axes TEXT NOT NULL, start_line INTEGER NOT NULL, on_disconnect TEXT NOT NULL,"
    " resume_of TEXT, state TEXT, accepted INTEGER NOT NULL, started INTEGER NOT NULL, done INTEGER NOT NULL,"
    " fault BLOB, opened_at REAL NOT NULL, ended_at REAL)",
    # one row a message, not a line: 500 000 lines/s in messages of 100 are 5 000 rows/s
    "CREATE TABLE IF NOT EXISTS chunks("
    " id INTEGER PRIMARY KEY, program TEXT NOT NULL, first INTEGER NOT NULL, last INTEGER NOT NULL,"
    " lines BLOB NOT NULL)",
    "CREATE INDEX IF NOT EXISTS chunks_by_program ON chunks(program, first)",
    "CREATE TABLE IF NOT EXISTS reports("
    " id INTEGER PRIMARY KEY, program TEXT NOT NULL, first INTEGER NOT NULL, last INTEGER NOT NULL,"
    " blob BLOB NOT NULL)",
    "CREATE INDEX IF NOT EXISTS reports_by_program ON reports(program, first)",
    "CREATE TABLE IF NOT EXISTS faults("
    " id INTEGER PRIMARY KEY, at REAL NOT NULL, program TEXT, line INTEGER NOT NULL, blob BLOB NOT NULL)",
)
