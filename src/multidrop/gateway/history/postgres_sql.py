"""The schema of a history in PostgreSQL, and what is asked of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from multidrop.errors import UsageError

if TYPE_CHECKING:
    import psycopg

VERSION = 1

LOCK = 0x6D645F68
"""Advisory lock, held while the tables are made: two that start at once do not meet."""

SCHEMA = """
CREATE TABLE about (version int NOT NULL);
CREATE TABLE series (
    id serial PRIMARY KEY, device text NOT NULL, point text NOT NULL, UNIQUE (device, point)
);
CREATE TABLE spans (
    id serial PRIMARY KEY, run text NOT NULL, number int NOT NULL,
    start bigint NOT NULL, until bigint NOT NULL, shift bigint NOT NULL,
    synchronised boolean, ended text NOT NULL, batch bigint NOT NULL, UNIQUE (run, number)
);
CREATE TABLE gaps (start bigint NOT NULL, until bigint NOT NULL, reason text NOT NULL, samples bigint);
CREATE TABLE recent (
    time bigint NOT NULL, number double precision, series int NOT NULL, span int NOT NULL,
    quality smallint NOT NULL, text text
);
CREATE INDEX recent_of_series ON recent (series, span, time);
CREATE TABLE blocks (
    first bigint NOT NULL, last bigint NOT NULL,
    minimum double precision, maximum double precision, final double precision,
    series int NOT NULL, span int NOT NULL, count int NOT NULL, gap boolean NOT NULL,
    final_text text, times bigint[] NOT NULL, numbers double precision[] NOT NULL,
    texts text[], qualities smallint[]
);
CREATE INDEX blocks_of_series ON blocks (series, span, first, last);
CREATE VIEW samples AS
SELECT device, point, '1970-01-01 UTC'::timestamptz + time * interval '1 microsecond' AS time,
    (time - shift) / 1e6 AS monotonic, synchronised, every.number, text,
    (ARRAY['good', 'stale', 'refused', 'wrong answer', 'no reply', 'port lost'])[quality + 1] AS quality
FROM (
    SELECT series, span, time, number, text, quality FROM recent
    UNION ALL
    SELECT series, span, time, number, texts[place], coalesce(qualities[place], 0)
    FROM blocks, unnest(times, numbers) WITH ORDINALITY AS one (time, number, place)
) AS every (series, span, time, number, text, quality)
JOIN series ON series.id = every.series JOIN spans ON spans.id = every.span;
"""

SEAL = """
INSERT INTO blocks
SELECT first, last, minimum, maximum,
    CASE WHEN final_text IS NULL THEN numbers[place] END, series, span, count, gap,
    final_text, times, numbers, texts, qualities
FROM (
    SELECT *, CASE WHEN texts IS NOT NULL THEN texts[place] END AS final_text FROM (
        SELECT series, span, min(time) AS first, max(time) AS last,
            min(number) FILTER (WHERE quality = 0) AS minimum,
            max(number) FILTER (WHERE quality = 0) AS maximum,
            count(*) FILTER (WHERE good) AS count, count(*) > count(*) FILTER (WHERE good) AS gap,
            max(nth) FILTER (WHERE good) - min(nth) + 1 AS place,
            array_agg(time ORDER BY nth) AS times, array_agg(number ORDER BY nth) AS numbers,
            CASE WHEN count(text) > 0 THEN array_agg(text ORDER BY nth) END AS texts,
            CASE WHEN max(quality) > 0 THEN array_agg(quality ORDER BY nth) END AS qualities
        FROM (
            SELECT *, quality = 0 AND (number IS NOT NULL OR text IS NOT NULL) AS good,
                row_number() OVER (PARTITION BY series, span ORDER BY time) AS nth
            FROM recent
        ) AS counted
        GROUP BY series, span, (nth - 1) / %s
    ) AS grouped
) AS whole
"""
"""All fresh samples of a point and span into blocks of so many at most."""

SERIES = "SELECT device, point FROM series ORDER BY 1, 2"
ALL_SERIES = "SELECT id, device, point FROM series"
SERIES_ID = "SELECT id FROM series WHERE device = %s AND point = %s"
COUNT_FRESH = "SELECT series, count(*) FROM recent GROUP BY series"
SPANS = "SELECT id, start, until, shift, synchronised, ended FROM spans ORDER BY id"
LOSSES = "SELECT start, until, reason, samples FROM gaps WHERE start < %s AND until >= %s"
CHUNKS = """
SELECT times, numbers, texts, qualities FROM blocks
WHERE series = %s AND span = %s AND first < %s AND last >= %s ORDER BY first
"""
PIECES = """
SELECT first, count, minimum, maximum, final, final_text, gap,
    CASE WHEN across THEN times END, CASE WHEN across THEN numbers END,
    CASE WHEN across THEN texts END, CASE WHEN across THEN qualities END
FROM (
    SELECT *, first < %s OR last >= %s OR (first - %s) / %s <> (last - %s) / %s AS across
    FROM blocks WHERE series = %s AND span = %s AND first < %s AND last >= %s
) AS found ORDER BY first
"""
FRESH = """
SELECT time, number, text, quality FROM recent
WHERE series = %s AND span = %s AND time >= %s AND time < %s ORDER BY time
"""
NEWEST_FRESH = """
SELECT span, time, number, text, quality FROM recent
WHERE series = %s AND (%s::int IS NULL OR span = %s) AND (%s::bigint IS NULL OR time < %s)
ORDER BY span DESC, time DESC LIMIT 1
"""
NEWEST_BLOCK = """
SELECT span, times, numbers, texts, qualities FROM blocks
WHERE series = %s AND (%s::int IS NULL OR span = %s) AND (%s::bigint IS NULL OR first < %s)
ORDER BY span DESC, first DESC LIMIT 1
"""
FORGET = """
DELETE FROM blocks WHERE ctid = ANY (ARRAY(
    SELECT ctid FROM blocks WHERE series = %s AND last < %s ORDER BY span, first LIMIT %s
))
"""


def prepare(connection: psycopg.Connection[tuple[Any, ...]], schema: str) -> None:
    """Make the schema and its tables where they are missing. Raises `UsageError` for another version."""
    from psycopg import sql

    name = sql.Identifier(schema)
    connection.execute("SELECT pg_advisory_xact_lock(%s)", (LOCK,))
    row = connection.execute(
        "SELECT count(*) FROM information_schema.tables WHERE table_schema = %s AND table_name = 'about'",
        (schema,),
    ).fetchone()
    missing = row is not None and row[0] == 0
    if missing:
        connection.execute(sql.SQL("CREATE SCHEMA IF NOT EXISTS {}").format(name))
    connection.execute(sql.SQL("SET search_path TO {}").format(name))
    if missing:
        connection.execute(SCHEMA.encode())
        connection.execute("INSERT INTO about VALUES (%s)", (VERSION,))
    found = connection.execute("SELECT version FROM about").fetchone()
    if found != (VERSION,):
        raise UsageError(f"schema {schema}: not a history of multidrop of version {VERSION}")
    connection.commit()
