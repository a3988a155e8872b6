"""Results as tables and as self-contained HTML pages with figures."""
