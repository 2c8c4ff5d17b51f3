"""What passes on a line: listened to, recorded, decoded, shown in Wireshark."""
