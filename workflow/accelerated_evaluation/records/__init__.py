"""Lane-change records: their sources, validation, filters and segments of lead speed."""
