"""Work with the native module, which nothing else imports."""
