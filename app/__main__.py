"""`python -m app`: the same as the `degense` command."""

from degense.app.cli.main import main

raise SystemExit(main())
