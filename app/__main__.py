"""`python -m app`: the same as the `degense` command."""

from app.cli import main

raise SystemExit(main())
