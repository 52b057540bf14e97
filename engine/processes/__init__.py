"""Work in processes of their own: how many at a time a machine holds, what each may use, and how one is told what to do."""
