"""The service: workspaces of several users over HTTP, and the queue of their jobs."""
