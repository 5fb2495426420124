"""Events and estimates as MessagePack: what goes over the ports and into the journal.

Versioned apart from the package.
"""
