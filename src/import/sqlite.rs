//! Reader of bags in SQLite: tables `topics(id, name, type, ...)` and `messages(topic_id,
//! timestamp, data)`, from ROS 2 Iron on with `message_definitions(topic_type, encoding,
//! encoded_message_definition)`.

use super::{
    bag::{Bag, BagTopic, Wanted},
    error::ImportError,
    report::Notice,
};
use crate::units::Nanos;
use rusqlite::{Connection, OpenFlags};
use std::{collections::BTreeMap, path::Path};

/// Read one file; `shown` is its name for messages.
pub(super) fn read_bag(path: &Path, shown: &Path, wanted: Wanted<'_>) -> Result<Bag, ImportError> {
    let database = open(path).map_err(refused(shown))?;
    let definitions = read_definitions(&database);
    let mut bag = Bag::default();
    for (id, name, type_name) in read_topics(&database).map_err(refused(shown))? {
        let mut topic = BagTopic {
            count: 0,
            definition: definitions.get(&type_name).cloned(),
            messages: Vec::new(),
            name,
            type_name,
        };
        let result = if wanted(&topic.name, &topic.type_name) {
            read_messages(&database, id, &mut topic, shown)?
        } else {
            count_messages(&database, id, &mut topic)
        };
        if let Err(error) = result {
            bag.notices.push(Notice::Damaged {
                file: shown.display().to_string(),
                what: format!("topic {} ends after {} messages: {error}", topic.name, topic.count),
            });
        }
        bag.topics.push(topic);
    }
    Ok(bag)
}

fn refused(path: &Path) -> impl Fn(rusqlite::Error) -> ImportError {
    let path = path.to_owned();
    move |error| ImportError::Sqlite { path: path.clone(), reason: error.to_string() }
}

/// Open without writing; a bag on a read-only medium is opened as immutable.
fn open(path: &Path) -> rusqlite::Result<Connection> {
    let read_only = OpenFlags::SQLITE_OPEN_READ_ONLY;
    let works = |database: Connection| {
        database.query_row("SELECT count(*) FROM sqlite_master", [], |_row| Ok(()))?;
        Ok(database)
    };
    Connection::open_with_flags(path, read_only).and_then(works).or_else(
        |first: rusqlite::Error| {
            let escaped: String = path
                .to_string_lossy()
                .chars()
                .map(|c| match c {
                    '%' => "%25".to_owned(),
                    '?' => "%3f".to_owned(),
                    '#' => "%23".to_owned(),
                    other => other.to_string(),
                })
                .collect();
            let uri = format!("file:{escaped}?immutable=1");
            Connection::open_with_flags(uri, read_only | OpenFlags::SQLITE_OPEN_URI)
                .and_then(works)
                .map_err(|_same| first)
        },
    )
}

fn read_topics(database: &Connection) -> rusqlite::Result<Vec<(i64, String, String)>> {
    let mut query = database.prepare("SELECT id, name, type FROM topics ORDER BY id")?;
    let rows = query.query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)))?;
    rows.collect()
}

/// Return encoding and text by type; empty when the table is missing (Humble and older).
fn read_definitions(database: &Connection) -> BTreeMap<String, (String, String)> {
    let read = || -> rusqlite::Result<BTreeMap<_, _>> {
        let mut query = database.prepare(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions",
        )?;
        let rows = query.query_map([], |row| Ok((row.get(0)?, (row.get(1)?, row.get(2)?))))?;
        rows.filter(|row| !matches!(row, Ok((_, (_, text))) if String::is_empty(text))).collect()
    };
    read().unwrap_or_default()
}

fn count_messages(database: &Connection, id: i64, topic: &mut BagTopic) -> rusqlite::Result<()> {
    let count: i64 =
        database.query_row("SELECT count(*) FROM messages WHERE topic_id = ?1", [id], |row| {
            row.get(0)
        })?;
    topic.count = u64::try_from(count).unwrap_or(0);
    Ok(())
}

/// Read as far as the file allows; the inner result is the error that ended it.
fn read_messages(
    database: &Connection,
    id: i64,
    topic: &mut BagTopic,
    shown: &Path,
) -> Result<rusqlite::Result<()>, ImportError> {
    let mut rows_of = || -> rusqlite::Result<Option<i64>> {
        let mut query = database.prepare(
            "SELECT timestamp, data FROM messages WHERE topic_id = ?1 ORDER BY timestamp, id",
        )?;
        let mut rows = query.query([id])?;
        while let Some(row) = rows.next()? {
            let nanos: i64 = row.get(0)?;
            let Ok(time) = u64::try_from(nanos) else { return Ok(Some(nanos)) };
            topic.messages.push((Nanos(time), row.get(1)?));
            topic.count += 1;
        }
        Ok(None)
    };
    match rows_of() {
        Ok(None) => Ok(Ok(())),
        Ok(Some(nanos)) => Err(ImportError::NegativeTime {
            path: shown.to_owned(),
            topic: topic.name.clone(),
            nanos,
        }),
        Err(error) => Ok(Err(error)),
    }
}
