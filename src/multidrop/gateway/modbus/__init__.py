"""The plant's points as registers of a Modbus TCP server."""
