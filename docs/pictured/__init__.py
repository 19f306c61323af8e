"""Pictures for pages whose runs draw no figure."""
