"""Laws of cut-ins: how each is put together, drawn from, scored and stored."""
