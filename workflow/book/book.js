// The search shows an excerpt of each page that it finds, for which it fetches the page. Browsers refuse this to
// pages that were opened from a disk, so there it shows titles alone.
DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = location.protocol !== "file:";
