"""What has been recorded, again: logs of ours and data of others through the on-board navigation."""
