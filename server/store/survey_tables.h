// The control points in the map file: raw input, replaced as a whole, kept by a rebuild.
#ifndef PORTOLAN_SERVER_STORE_SURVEY_TABLES_H_
#define PORTOLAN_SERVER_STORE_SURVEY_TABLES_H_

#include "common/base/status.h"
#include "server/georeference/survey.h"
#include "server/store/sqlite.h"

namespace portolan {

// Inside the caller's transaction.
Status WriteSurvey(SqliteDatabase& database, const Survey& survey);
// DataLoss if what is stored is not valid.
StatusOr<Survey> ReadSurvey(SqliteDatabase& database);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_STORE_SURVEY_TABLES_H_
