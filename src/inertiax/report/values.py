"""What a document for scripts may hold."""

Value = str | int | float | bool | None | list["Value"] | dict[str, "Value"]
